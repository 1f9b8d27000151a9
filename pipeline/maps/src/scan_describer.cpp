#include "scan_describer.h"

#include <algorithm>
#include <utility>

#include "map_format.h"
#include "revisit/base/error.h"
#include "revisit/recognition/align.h"

namespace revisit {

ScanDescriber::ScanDescriber(const FeatureExtractor& extractor, const RecognizerOptions& options)
    : extractor_(extractor), options_(options) {
  // Create one worker now: an unusable extractor throws here, not at the first scan.
  give_back(take());
}

std::unique_ptr<ScanDescriber::Worker> ScanDescriber::take() const {
  const std::scoped_lock lock(mutex_);
  if (idle_.empty())
    return std::make_unique<Worker>(
        Worker{from_scan(extractor_, options_.align, options_.geometry), {}});
  std::unique_ptr<Worker> worker = std::move(idle_.back());
  idle_.pop_back();
  return worker;
}

void ScanDescriber::give_back(std::unique_ptr<Worker> worker) const {
  const std::scoped_lock lock(mutex_);
  idle_.push_back(std::move(worker));
}

Description ScanDescriber::describe(const PointsView& points) const {
  std::unique_ptr<Worker> worker = take();
  Description scan;
  copy_points(points, worker->cloud);
  transform(options_.mount, worker->cloud);
  scan.feature.resize(static_cast<size_t>(extractor_.dim));
  try {
    if (std::ranges::none_of(worker->cloud.points, is_return))
      throw InputError("the scan has no points");
    worker->describe(worker->cloud, scan.feature);
    if (!is_usable(scan.feature)) throw InputError("its feature has ", kTooLarge);
  } catch (const InputError& error) {
    scan = {{}, error.what()};
  }
  give_back(std::move(worker));
  return scan;
}

}  // namespace revisit
