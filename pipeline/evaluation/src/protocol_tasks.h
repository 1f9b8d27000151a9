#pragma once

#include <string>

#include "revisit/evaluation/protocols.h"

namespace revisit {

// make_tasks() sets name and definition. Each throws UsageError if the sequence has no such task.

Task paper_easy_task(const Trajectory& trajectory);
/// Sequences of the paper's Table 1; difficult ones have reverse revisits.
bool has_median_task(const std::string& sequence);
bool has_difficult_task(const std::string& sequence);
Task paper_median_task(const std::string& sequence, const Trajectory& trajectory);
Task paper_difficult_task(const std::string& sequence, const Trajectory& trajectory);

Task online_task(const Trajectory& trajectory, const Exclusion& exclusion);
Task leave_one_out_task(const Trajectory& trajectory, const Exclusion& exclusion);

Task lcdnet1_task(const Trajectory& trajectory, const Exclusion& exclusion);
Task lcdnet2_task(const Trajectory& trajectory, const Exclusion& exclusion);
Task ssc_task(const Trajectory& trajectory, const Exclusion& exclusion);
Task logg3d_task(const Trajectory& trajectory, const Exclusion& exclusion);
Task places_task(int step, const Trajectory& trajectory);
Task bevplace_task(const std::string& sequence, const Trajectory& trajectory);

}  // namespace revisit
