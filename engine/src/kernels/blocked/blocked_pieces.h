#pragma once

#include <algorithm>
#include <cstdint>

#include "kernels/blocked/blocked_size.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {

/// Kernels that map zero to nonzero values must call it: Layout::kNChw16c requires zeros.
template <class T>
void clear_tail_lanes(int64_t c, int64_t block, int64_t pixels, T* output) {
  const int64_t used = std::clamp<int64_t>(c - block * kLanes, 0, kLanes);
  if (used == kLanes) return;
  for (int64_t i = 0; i < pixels; ++i)
    std::fill(output + i * kLanes + used, output + (i + 1) * kLanes, T{});
}

/// Calls `work(block, begin, end)` for parts of planes that together cover the value: the numbers
/// [begin, end) belong to the channels of block `block` of their image.
template <class Work>
void for_each_piece(const BlockedSize& size, const Work& work) {
  constexpr int64_t kPixels = kParallelGrain / kLanes;
  const int64_t blocks = channel_blocks(size.c), pieces = (size.pixels + kPixels - 1) / kPixels;
  parallel_for(size.planes() * pieces, size.threads, [&](int64_t item, int) {
    const int64_t plane = item / pieces, first = item % pieces * kPixels;
    const int64_t last = std::min(first + kPixels, size.pixels);
    const int64_t origin = plane * size.pixels;
    work(plane % blocks, (origin + first) * kLanes, (origin + last) * kLanes);
  });
}

}  // namespace revisit::engine
