#pragma once

#include <array>
#include <span>
#include <vector>

#include "revisit/engine/net.h"
#include "revisit/engine/tensor.h"

namespace revisit {

/// Each input channel is (image - mean) * scale. A first convolution takes the image once, as a
/// replicated single channel.
struct ImagePlan {
  engine::Plan plan;
  engine::Port input;  // one channel if replicated, else all
  std::vector<float> means;
  float scale = 1;
  /// `pixels` has the size of the input's channels.
  void fill(engine::Run& run, std::span<const float> pixels) const;
};

/// Throws InputError unless the net has exactly one input, of 1 or 3 channels, and takes the size.
ImagePlan plan_for_images(const engine::Net& net, int height, int width,
                          const std::array<double, 3>& mean_bgr, double scale,
                          engine::PlanOptions options);

/// Suffix of FeatureExtractor::key.
inline const char* precision_key(engine::Precision precision) {
  return precision == engine::Precision::kBf16 ? "\nbf16" : "";
}

}  // namespace revisit
