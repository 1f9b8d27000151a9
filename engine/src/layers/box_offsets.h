#pragma once

#include <array>

#include "caffe_schema.pb.h"

namespace revisit::engine {

/// Mean and deviation of a box's four offsets (bbox_reg_param of MS-CNN).
class BoxOffsets {
 public:
  BoxOffsets() = default;
  /// Uses means and deviations only if both are given.
  explicit BoxOffsets(const caffe::BBoxRegParameter& param);

  float apply(size_t i, float number) const { return number * deviations_[i] + means_[i]; }

 private:
  std::array<float, 4> means_{0, 0, 0, 0}, deviations_{1, 1, 1, 1};
};

}  // namespace revisit::engine
