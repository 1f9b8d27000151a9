#pragma once

#include "eval/run_folder.h"
#include "reports.pb.h"

namespace revisit::cli {

/// Maximum per query with range images.
inline constexpr int kShownMatches = 4;

/// Content of report.json, without range images; `info` is run.json, `metrics` is metrics.json.
reports::Run run_data(const RunContext& context, const std::vector<TaskResult>& results,
                      const reports::RunInfo& info, const reports::MetricsList& metrics);

/// One task of metrics.json without NaN; `pose_source` names the ground truth, e.g. a poses file.
reports::Metrics metrics_report(const PrSummary& summary, const Task& task,
                                const std::string& pose_source);

/// Intervals that were not computed stay empty.
void add_intervals(reports::Metrics& metrics, const PrIntervals& intervals, int resamples,
                   int64_t n_blocks);

}  // namespace revisit::cli
