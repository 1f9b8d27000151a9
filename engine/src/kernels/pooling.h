#pragma once

#include <cfloat>

#include "kernels/window_range.h"
#include "revisit/engine/precision.h"

namespace revisit::engine {

/// The maximum of nothing: the least number, also of those that bfloat16 has, as -FLT_MAX would be
/// rounded to -infinity there.
constexpr float empty_maximum(Precision values) {
  return values == Precision::kFloat32 ? -FLT_MAX : -0x1.FEp127F;
}

/// 2-D pooling of `planes` independent images `[h][w]` to `[out_h][out_w]`.
struct PoolingProblem {
  int64_t planes = 1, h = 1, w = 1, out_h = 1, out_w = 1;
  int64_t kernel_h = 1, kernel_w = 1, stride_h = 1, stride_w = 1, pad_h = 0, pad_w = 0;
  int threads = 1;
  Precision values = Precision::kFloat32;  // of blocked arrays; decides the empty_maximum()

  WindowRange rows(int64_t y) const { return {y * stride_h - pad_h, kernel_h, h}; }
  WindowRange columns(int64_t x) const { return {x * stride_w - pad_w, kernel_w, w}; }
  /// Sides of the area of a mean, of a window that starts there: clipped to the padded image.
  int64_t height(int64_t start) const { return std::min(start + kernel_h, h + pad_h) - start; }
  int64_t width(int64_t start) const { return std::min(start + kernel_w, w + pad_w) - start; }
};

/// Largest value of each window, clipped to the image; empty_maximum() where it is empty. NaN never
/// wins. `mask`, when not null, gets the winner's index h * w as float, -1 for none
/// (docs/LAYERS.md point 2).
void max_pool(const PoolingProblem& problem, const float* input, float* output, float* mask);

/// Mean of each window: padding counts as zeros, what lies beyond it does not count at all.
void average_pool(const PoolingProblem& problem, const float* input, float* output);

}  // namespace revisit::engine
