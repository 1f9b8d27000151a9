#include "take_scans.h"

#include "each.h"
#include "revisit/base/error.h"
#include "revisit/datasets/stopwatch.h"

namespace revisit::pipeline::simulation {

void take_scans(int64_t missing, int threads, const std::filesystem::path& folder,
                const std::function<void(int64_t item, int thread)>& take,
                const std::function<void(int64_t, int64_t)>& progress,
                const std::function<bool()>& stop, SimulationSummary& summary) {
  Stopwatch watch;
  const int64_t total = summary.scans + missing;
  bool stopped = false;
  const auto count = [&](int64_t) {
    ++summary.scans;
    if (progress) progress(summary.scans, total);
    stopped = stopped || (stop && summary.scans < total && stop());
    return !stopped;
  };
  for_each_item(missing, threads, take, count);
  if (stopped)
    throw Interrupted(str("interrupted: ", summary.scans, " of ", total, " scans are complete in ",
                          folder.string(), "; run the same command again to continue"));
  summary.scan_seconds = watch.lap() / 1000;
}

double mean_points(std::span<const std::filesystem::path> files) {
  constexpr double kBytesPerPoint = 16;
  uintmax_t bytes = 0;
  for (const std::filesystem::path& file : files) bytes += std::filesystem::file_size(file);
  return static_cast<double>(bytes) / kBytesPerPoint / static_cast<double>(files.size());
}

}  // namespace revisit::pipeline::simulation
