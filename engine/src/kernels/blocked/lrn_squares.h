#pragma once

#include <algorithm>
#include <cstdint>

#include "kernels/lrn.h"
#include "layout.h"

namespace revisit::engine {

/// Squares of some pixels, pixel after pixel: all channels consecutively, zeros on both sides.
struct LrnSquares {
  int64_t half;    // neighbors on either side, limited to existing channels
  int64_t margin;  // zeros on either side, a multiple of kLanes
  int64_t pitch;   // stride of pixels
  int64_t pixels;

  explicit LrnSquares(const LrnProblem& p)
      : half(std::min(p.size / 2, p.c - 1)),
        margin(padded_channels(half)),
        pitch(padded_channels(p.c) + 2 * margin),
        pixels(std::clamp<int64_t>(kFloats / pitch, 1, kLanes)) {}

  int64_t floats() const { return pixels * pitch; }

 private:
  static constexpr int64_t kFloats = 4096;  // leaves room for the pixels in the L1 cache
};

}  // namespace revisit::engine
