#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "revisit/maps/place_recognizer.h"

namespace revisit {

/// Thread-safe. Keeps references to its arguments.
class ScanDescriber {
 public:
  /// Throws UsageError for a feature that is not computed from scans.
  ScanDescriber(const FeatureExtractor& extractor, const RecognizerOptions& options);
  Description describe(const PointsView& points) const;

 private:
  struct Worker {
    FeatureFunction<PointCloud> describe;
    PointCloud cloud;
  };
  std::unique_ptr<Worker> take() const;
  void give_back(std::unique_ptr<Worker> worker) const;

  const FeatureExtractor& extractor_;
  const RecognizerOptions& options_;
  mutable std::mutex mutex_;
  mutable std::vector<std::unique_ptr<Worker>> idle_;
};

}  // namespace revisit
