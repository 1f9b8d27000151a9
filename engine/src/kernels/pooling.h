#pragma once

#include <cfloat>

#include "kernels/window.h"
#include "revisit/engine/tensor.h"

namespace revisit::engine {

/// Maximum of an empty window: the lowest value of the type, because bfloat16 rounds -FLT_MAX to
/// -infinity.
constexpr float empty_maximum(Precision values) {
  return values == Precision::kFloat32 ? -FLT_MAX : -0x1.FEp127F;
}

/// 2-D pooling of `planes` independent images `[h][w]` to `[out_h][out_w]`.
struct PoolingProblem {
  int64_t planes = 1, h = 1, w = 1, out_h = 1, out_w = 1;
  int64_t kernel_h = 1, kernel_w = 1, stride_h = 1, stride_w = 1, pad_h = 0, pad_w = 0;
  int threads = 1;
  Precision values = Precision::kFloat32;  // NCHWc arrays; determines empty_maximum()

  WindowRange rows(int64_t y) const { return {y * stride_h - pad_h, kernel_h, h}; }
  WindowRange columns(int64_t x) const { return {x * stride_w - pad_w, kernel_w, w}; }
  /// Size of the averaged area of a window at `start`, clipped to the padded image.
  int64_t height(int64_t start) const { return std::min(start + kernel_h, h + pad_h) - start; }
  int64_t width(int64_t start) const { return std::min(start + kernel_w, w + pad_w) - start; }
};

/// Maximum of each window, clipped to the image; empty_maximum() if it is empty. NaN is ignored.
/// `mask`, if not null, receives the index h * w of the maximum as float, -1 for none
/// (docs/LAYERS.md point 2).
void max_pool(const PoolingProblem& problem, const float* input, float* output, float* mask);

/// Mean of each window: padding counts as zeros, the area beyond it does not count.
void average_pool(const PoolingProblem& problem, const float* input, float* output);

}  // namespace revisit::engine
