#pragma once

#include <algorithm>

#include "kernels/blocked/column_panels.h"
#include "kernels/convolution.h"
#include "layout.h"

namespace revisit::engine {

/// F(rows x columns, taps x taps): outputs per tile, and taps.
struct WinogradVariant {
  const char* name;
  int rows, columns, taps;
  int points() const { return (rows + taps - 1) * (columns + taps - 1); }
};

/// Partition of a problem for one variant. At every point, tiles are the columns of a matrix
/// product. A chunk of tiles is transformed, multiplied and transformed back by slices of output
/// channels, so that transformed inputs and products fit the cache.
struct WinogradShape {
  static constexpr int64_t kMaxChunkPanels = 4;

  int64_t points, tiles_y, tiles_x;
  int64_t in_blocks, out_blocks;  // all groups
  int64_t group;
  int64_t slice_blocks;
  Chunks chunks;  // tiles of all images

  WinogradShape(const WinogradVariant& v, const ConvolutionProblem& p)
      : points(v.points()),
        tiles_y((p.out_h + v.rows - 1) / v.rows),
        tiles_x((p.out_w + v.columns - 1) / v.columns),
        in_blocks(channel_blocks(p.c_in)),
        out_blocks(channel_blocks(p.c_out)),
        group(p.group),
        slice_blocks(in_blocks_per_group() <= kShallow ? 2 : 4),
        chunks(cut_into_chunks(1, p.n * tiles_y * tiles_x,
                               in_blocks_per_group() < kDeep ? 2 : kMaxChunkPanels, p.threads)) {
    if (!chunks.per_thread && slices() < 2 * p.threads) slice_blocks = 2;
  }

  int64_t tiles() const { return chunks.columns.items; }
  int64_t in_blocks_per_group() const { return in_blocks / group; }
  int64_t out_blocks_per_group() const { return out_blocks / group; }

  int64_t slices_per_group() const {
    return (out_blocks_per_group() + slice_blocks - 1) / slice_blocks;
  }
  int64_t slices() const { return group * slices_per_group(); }

  int64_t inputs_floats() const { return chunks.columns.widest() * in_blocks * points * kLanes; }
  int64_t products_floats() const {
    return chunks.columns.widest() * std::min(slice_blocks, out_blocks_per_group()) * points *
           kLanes;
  }
  int64_t scratch_floats(int threads) const {
    return (chunks.per_thread ? threads : 1) * inputs_floats() + threads * products_floats();
  }

 private:
  // Measured: for short sums the products dominate the memory traffic, for longer ones the inputs,
  // then the weights, which each chunk reads once.
  static constexpr int64_t kShallow = 8, kDeep = 32;  // blocks
};

}  // namespace revisit::engine
