#pragma once

#include <algorithm>
#include <cmath>

#include "kernels/channel_runs.h"
#include "kernels/epilogue.h"

namespace revisit::engine {

// Caffe's own expressions: they decide what becomes of NaN and infinity.
inline float leaky_relu(float x, float slope) {
  return std::max(x, 0.0F) + slope * std::min(x, 0.0F);
}
inline float elu(float x, float alpha) {
  return std::max(x, 0.0F) + alpha * (std::exp(std::min(x, 0.0F)) - 1);
}
inline float clipped(float x, float low, float high) {
  return std::min(std::max(x, low), high);
}

/// What blocked kernels do while results are in registers, for kernels that do not.
struct PostOps {
  const float* scale = nullptr;  // [channels]; null: 1
  const float* shift = nullptr;  // [channels], there when scale is
  const float* addend = nullptr;
  Epilogue epilogue = {};
};

/// Changes `values` in place: scale and shift, addend, activation.
void apply(const PostOps& post_ops, const ChannelRuns& runs, int threads, float* values);

}  // namespace revisit::engine
