#pragma once

#include <algorithm>

#include "kernels/blocked/columns.h"
#include "kernels/convolution.h"
#include "layout.h"

namespace revisit::engine {

/// F(rows x columns, taps x taps): the outputs of one tile.
struct WinogradVariant {
  const char* name;
  int rows, columns, taps;
  int points() const { return (rows + taps - 1) * (columns + taps - 1); }
};

/// How a problem is cut up for one variant. Tiles are the columns of a matrix product for every
/// point; they are worked on in chunks, so that the transformed input of a chunk and the products
/// of a slice of output channels stay in cache.
struct WinogradShape {
  static constexpr int64_t kMostChunkStrips = 4;

  int64_t points, tiles_y, tiles_x;
  int64_t in_blocks, out_blocks;  // of all groups
  int64_t group;
  Strips strips;  // of the tiles of all images
  int64_t chunk_strips, slice_blocks;

  WinogradShape(const WinogradVariant& v, const ConvolutionProblem& p)
      : points(v.points()),
        tiles_y((p.out_h + v.rows - 1) / v.rows),
        tiles_x((p.out_w + v.columns - 1) / v.columns),
        in_blocks(channel_blocks(p.c_in)),
        out_blocks(channel_blocks(p.c_out)),
        group(p.group),
        strips{p.n * tiles_y * tiles_x},
        chunk_strips(in_blocks_per_group() < kDeep ? 2 : 4),
        slice_blocks(in_blocks_per_group() <= kShallow ? 2 : 4) {
    if (!chunk_per_thread(p.threads) && slices() < 2 * p.threads) slice_blocks = 2;
  }

  int64_t in_blocks_per_group() const { return in_blocks / group; }
  int64_t out_blocks_per_group() const { return out_blocks / group; }

  int64_t chunks() const { return (strips.size() + chunk_strips - 1) / chunk_strips; }
  int64_t first_strip(int64_t chunk) const { return strips.size() * chunk / chunks(); }
  int64_t most_chunk_tiles() const {
    return std::min(strips.count, std::min(strips.size(), chunk_strips) * kMaxColumns);
  }

  int64_t slices_per_group() const {
    return (out_blocks_per_group() + slice_blocks - 1) / slice_blocks;
  }
  int64_t slices() const { return group * slices_per_group(); }

  /// Enough chunks that every thread takes its own; else all threads work on the same one.
  bool chunk_per_thread(int threads) const { return threads == 1 || chunks() >= 4 * threads; }

  int64_t inputs_floats() const { return most_chunk_tiles() * in_blocks * points * kLanes; }
  int64_t products_floats() const {
    return most_chunk_tiles() * std::min(slice_blocks, out_blocks_per_group()) * points * kLanes;
  }
  int64_t scratch_floats(int threads) const {
    return (chunk_per_thread(threads) ? threads : 1) * inputs_floats() +
           threads * products_floats();
  }

 private:
  // Measured: with a short sum the products dominate the traffic, with a long one the inputs, and
  // then the weights, which every chunk reads once.
  static constexpr int64_t kShallow = 8, kDeep = 32;  // blocks
};

}  // namespace revisit::engine
