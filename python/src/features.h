#pragma once

#include <mutex>
#include <vector>

#include "revisit/recognition/feature.h"

namespace revisit::python {

/// Thread-safe: concurrent calls are serialized.
class ScanFeature {
 public:
  ScanFeature(const pipeline::FeatureExtractor& extractor, pipeline::AlignCase align,
              const pipeline::ImageGeometry& geometry)
      : dim_(extractor.dim), describe_(pipeline::from_scan(extractor, align, geometry)) {}

  std::vector<float> of(const pipeline::PointCloud& cloud) {
    std::vector<float> feature(static_cast<size_t>(dim_));
    const std::lock_guard lock(mutex_);
    describe_(cloud, feature);
    return feature;
  }

 private:
  int64_t dim_;
  std::mutex mutex_;
  pipeline::FeatureFunction<pipeline::PointCloud> describe_;
};

}  // namespace revisit::python
