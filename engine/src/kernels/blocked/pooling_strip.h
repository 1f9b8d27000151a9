#pragma once

#include <algorithm>
#include <cstdint>

#include "kernels/pooling.h"
#include "layout.h"

namespace revisit::engine {

/// Windows side by side, from the top of the image to its bottom: the unit of work where pooling
/// is done with what comes before it. One row of its pixels, all channels, stays in cache.
struct PoolingStrip {
  int64_t windows;
  int64_t columns;  // of the image that they read, at most
  int64_t per_image;
  int64_t row_floats;  // of one row of its pixels

  PoolingStrip(const PoolingProblem& p, int64_t channels) {
    // Enough strips for some threads, of equal size; few enough that what neighbours both make (a
    // window reads columns of the next) counts little.
    constexpr int64_t kRowFloats = 16384, kFewStrips = 2, kFewWindows = 8;
    const int64_t wanted = kRowFloats / padded_channels(channels);
    const int64_t most = std::clamp<int64_t>((wanted - p.kernel_w) / p.stride_w + 1, 1, p.out_w);
    const int64_t needed = (p.out_w + most - 1) / most;
    const int64_t few = std::clamp<int64_t>(p.out_w / kFewWindows, 1, kFewStrips);
    const int64_t strips = needed <= few ? few : (needed + 1) / 2 * 2;
    windows = (p.out_w + strips - 1) / strips;
    columns = std::min((windows - 1) * p.stride_w + p.kernel_w, p.w);
    per_image = (p.out_w + windows - 1) / windows;
    row_floats = columns * padded_channels(channels);
  }
};

}  // namespace revisit::engine
