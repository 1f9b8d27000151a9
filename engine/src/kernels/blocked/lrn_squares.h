#pragma once

#include <algorithm>
#include <cstdint>

#include "kernels/lrn.h"
#include "layout.h"

namespace revisit::engine {

/// Where the squares of some pixels stand while their neighbours are added up: pixel after pixel,
/// all channels one behind the other, with zeros on both sides.
struct LrnSquares {
  int64_t half;    // neighbours on either side, those that exist for some channel
  int64_t margin;  // zeros on either side, a multiple of kLanes
  int64_t pitch;   // from one pixel to the next
  int64_t pixels;  // at a time

  explicit LrnSquares(const LrnProblem& p)
      : half(std::min(p.size / 2, p.c - 1)),
        margin(padded_channels(half)),
        pitch(padded_channels(p.c) + 2 * margin),
        pixels(std::clamp<int64_t>(kFloats / pitch, 1, kLanes)) {}

  int64_t floats() const { return pixels * pitch; }

 private:
  static constexpr int64_t kFloats = 4096;  // leaves room for the pixels in the first-level cache
};

}  // namespace revisit::engine
