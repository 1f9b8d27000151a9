#pragma once

#include <array>
#include <span>
#include <vector>

#include "revisit/engine/net.h"

namespace revisit::pipeline {

/// How a network runs on gray images: each of its input's channels is the image less a mean, times
/// a scale. Where a convolution sees it first the image is given once and stands for all channels.
struct ImagePlan {
  engine::Plan plan;
  engine::Port input;  // of one channel, or of all
  std::vector<float> means;
  float scale = 1;
  /// Fills the input of a run; `pixels` has the size of the input's channels.
  void fill(engine::Run& run, std::span<const float> pixels) const;
};

/// Throws InputError unless the net has exactly one input, of 1 or 3 channels, and takes the size.
ImagePlan plan_for_images(const engine::Net& net, int height, int width,
                          const std::array<double, 3>& mean_bgr, double scale,
                          engine::PlanOptions options);

}  // namespace revisit::pipeline
