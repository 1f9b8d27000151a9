#pragma once

#include <array>

#include "caffe_schema.pb.h"

namespace revisit::engine {

/// Mean and deviation of the four numbers that move a box (bbox_reg_param of MS-CNN).
class BoxOffsets {
 public:
  BoxOffsets() = default;
  /// Means and deviations count where both are given.
  explicit BoxOffsets(const caffe::BBoxRegParameter& param);

  float apply(size_t i, float number) const { return number * deviations_[i] + means_[i]; }

 private:
  std::array<float, 4> means_{0, 0, 0, 0}, deviations_{1, 1, 1, 1};
};

}  // namespace revisit::engine
