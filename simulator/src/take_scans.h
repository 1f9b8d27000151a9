#pragma once

#include <filesystem>
#include <functional>
#include <span>

#include "revisit/simulation/simulation.h"

namespace revisit::simulation {

/// `requested`: 0 means all cores. Returns at most `items`, at least 1.
int threads_for(int requested, int64_t items);

/// Calls take(item, thread) for the items [0, missing), in any order, and adds their count and time
/// to `summary`. Calls to progress() and stop() are serialized. Throws Interrupted with `folder` if
/// stop() returns true before the last item, and the exception of take() with the lowest item.
void run_scans(int64_t missing, int threads, const std::filesystem::path& folder,
               const std::function<void(int64_t item, int thread)>& take,
               const std::function<void(int64_t, int64_t)>& progress,
               const std::function<bool()>& stop, SimulationSummary& summary);

/// Computed from the sizes of `files`: .bin, or .pcd of write_pcd_scan().
double mean_points(std::span<const std::filesystem::path> files);

}  // namespace revisit::simulation
