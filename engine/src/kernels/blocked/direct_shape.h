#pragma once

#include <algorithm>

#include "kernels/blocked/columns.h"
#include "kernels/convolution.h"
#include "layout.h"

namespace revisit::engine {

/// How a convolution is cut up as one matrix product per image and group: its columns are output
/// pixels, its depth the blocks of input channels under every tap.
struct DirectShape {
  int64_t taps, in_blocks, out_blocks;  // of a group
  int64_t images;                       // and groups, each a product of its own
  Strips strips;                        // of the pixels of an image
  int64_t chunk_strips;                 // whose columns fit the cache

  explicit DirectShape(const ConvolutionProblem& p)
      : taps(p.kernel_h * p.kernel_w),
        in_blocks(channel_blocks(p.c_in_per_group())),
        out_blocks(channel_blocks(p.c_out_per_group())),
        images(p.n * p.group),
        strips{p.out_pixels()},
        chunk_strips(
            std::clamp<int64_t>(kChunkFloats / (kMaxColumns * kLanes * depth()), 1, kMostStrips)) {}

  int64_t depth() const { return taps * in_blocks; }
  int64_t weights_floats() const { return depth() * kLanes * kLanes; }  // of an output block

  int64_t chunks() const { return (strips.size() + chunk_strips - 1) / chunk_strips; }
  int64_t first_strip(int64_t chunk) const { return strips.size() * chunk / chunks(); }
  int64_t columns_floats() const {
    return std::min(strips.count, chunk_strips * kMaxColumns) * kLanes * depth();
  }

  int64_t slices() const { return (out_blocks + kSliceBlocks - 1) / kSliceBlocks; }

  /// Enough chunks that every thread takes its own; else all threads work on the same one.
  bool chunk_per_thread(int threads) const {
    return threads == 1 || images * chunks() >= 4 * threads;
  }

  static constexpr int64_t kSliceBlocks = 2;

 private:
  static constexpr int64_t kChunkFloats = 256 * 1024, kMostStrips = 8;
};

}  // namespace revisit::engine
