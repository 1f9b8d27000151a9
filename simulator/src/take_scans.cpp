#include "take_scans.h"

#include <omp.h>

#include <algorithm>
#include <atomic>
#include <mutex>

#include "revisit/base/error.h"
#include "revisit/datasets/observer.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::simulation {

int threads_for(int requested, int64_t items) {
  const int64_t most = requested > 0 ? requested : omp_get_max_threads();
  return static_cast<int>(std::clamp<int64_t>(items, 1, most));
}

void run_scans(int64_t missing, int threads, const std::filesystem::path& folder,
               const std::function<void(int64_t item, int thread)>& take,
               const std::function<void(int64_t, int64_t)>& progress,
               const std::function<bool()>& stop, SimulationSummary& summary) {
  Stopwatch watch;
  const int64_t total = summary.scans + missing;
  std::mutex mutex;
  std::atomic<bool> stopped = false;
  parallel_for(missing, threads, [&](int64_t item, int thread) {
    if (stopped) return;
    take(item, thread);
    const std::scoped_lock lock(mutex);
    ++summary.scans;
    if (progress) progress(summary.scans, total);
    if (!stopped && stop && summary.scans < total && stop()) stopped = true;
  });
  if (stopped)
    throw Interrupted("interrupted: ", summary.scans, " of ", total, " scans are complete in ",
                      folder.string(), "; run the same command again to resume");
  summary.scan_seconds = watch.lap() / 1000;
}

double mean_points(std::span<const std::filesystem::path> files) {
  uintmax_t points = 0;
  for (const std::filesystem::path& file : files) {
    const uintmax_t bytes = std::filesystem::file_size(file);
    points += file.extension() == ".pcd" ? (bytes - kPcdHeaderBytes) / kPcdPointBytes
                                         : bytes / sizeof(Point);
  }
  return static_cast<double>(points) / static_cast<double>(files.size());
}

}  // namespace revisit::simulation
