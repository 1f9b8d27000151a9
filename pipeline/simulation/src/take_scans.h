#pragma once

#include <filesystem>
#include <functional>
#include <span>

#include "revisit/simulation/simulation.h"

namespace revisit::pipeline::simulation {

/// How many threads share `items`, when `asked` for (0: all there are).
int threads_for(int asked, int64_t items);

/// Calls take(item, thread) for the items [0, missing), in no order, and adds them and their time
/// to `summary`. Calls progress() and stop() one at a time. Throws Interrupted, naming `folder`,
/// when stop() is true before the last one, and what take() throws of the lowest item.
void take_scans(int64_t missing, int threads, const std::filesystem::path& folder,
                const std::function<void(int64_t item, int thread)>& take,
                const std::function<void(int64_t, int64_t)>& progress,
                const std::function<bool()>& stop, SimulationSummary& summary);

/// Points of a scan, from the sizes of `files`: .bin, or .pcd of write_pcd_scan().
double mean_points(std::span<const std::filesystem::path> files);

}  // namespace revisit::pipeline::simulation
