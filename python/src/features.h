#pragma once

#include <mutex>
#include <vector>

#include "revisit/recognition/feature.h"

namespace revisit::python {

/// Thread-safe: concurrent calls are serialized.
class ScanFeature {
 public:
  ScanFeature(const FeatureExtractor& extractor, AlignCase align, const ImageGeometry& geometry)
      : dim_(extractor.dim), describe_(from_scan(extractor, align, geometry)) {}

  std::vector<float> of(const PointCloud& cloud) {
    std::vector<float> feature(static_cast<size_t>(dim_));
    const std::lock_guard lock(mutex_);
    describe_(cloud, feature);
    return feature;
  }

 private:
  int64_t dim_;
  std::mutex mutex_;
  FeatureFunction<PointCloud> describe_;
};

}  // namespace revisit::python
