#pragma once

#include <filesystem>
#include <functional>
#include <span>

#include "revisit/simulation/simulation.h"

namespace revisit::pipeline::simulation {

/// How many threads share `items`, when `asked` for (0: all there are).
int threads_for(int asked, int64_t items);

/// Takes the scans [0, missing) that are not there yet, each by take(item, thread), in no order,
/// and counts them in `summary.scans`, to which those found complete already belong; notes the time
/// they took. `folder` is what the message names. Calls progress() and stop() one at a time. Throws
/// Interrupted when stop() answered yes before the last one, and what the others throw, of the
/// lowest item, when the scans under way are finished.
void take_scans(int64_t missing, int threads, const std::filesystem::path& folder,
                const std::function<void(int64_t item, int thread)>& take,
                const std::function<void(int64_t, int64_t)>& progress,
                const std::function<bool()>& stop, SimulationSummary& summary);

/// Points of a scan, from the sizes of `files`.
double mean_points(std::span<const std::filesystem::path> files);

}  // namespace revisit::pipeline::simulation
