#pragma once

#include <algorithm>

#include "kernels/blocked/column_panels.h"
#include "kernels/blocked/tile_shape.h"
#include "kernels/convolution.h"
#include "layout.h"

namespace revisit::engine {

/// Partition for the multiplication: a panel of pixels at a time, in chunks of `chunk_numbers`
/// unfolded numbers that fit the L2 cache. CPUs with tiles have 2 MB of it.
struct DirectCut {
  Panel panel;
  int64_t chunk_numbers;
};
constexpr DirectCut kRegisterCut = {kRegisterPanel, 256 * 1024};
constexpr DirectCut kTileCut = {kTilePanel, 640 * 1024};

/// Partition of a convolution as one matrix product per image and group: its columns are output
/// pixels, its depth the blocks of input channels under all taps.
struct DirectShape {
  static constexpr int64_t kSliceBlocks = 2;

  int64_t taps, in_blocks, out_blocks;  // per group
  int64_t images;                       // images times groups, each a separate product
  int64_t packed_depth;  // weights' depth; bfloat16 is padded to full tiles for every kernel
  Panel panel;
  Chunks chunks;  // pixels of an image

  explicit DirectShape(const ConvolutionProblem& p, const DirectCut& cut = kRegisterCut)
      : taps(p.kernel_h * p.kernel_w),
        in_blocks(channel_blocks(p.c_in_per_group())),
        out_blocks(channel_blocks(p.c_out_per_group())),
        images(p.n * p.group),
        packed_depth(p.values == Precision::kBf16 ? (depth() + 1) / 2 * 2 : depth()),
        panel(cut.panel),
        chunks(cut_into_chunks(
            images, p.out_pixels(),
            std::clamp<int64_t>(cut.chunk_numbers / (panel.columns * kLanes * depth()), 1,
                                kMaxPanels),
            p.threads, panel)) {}

  int64_t depth() const { return taps * in_blocks; }
  int64_t weights() const { return packed_depth * kLanes * kLanes; }  // per output block
  int64_t columns_numbers() const { return chunks.columns.widest() * kLanes * packed_depth; }
  int64_t slices() const { return (out_blocks + kSliceBlocks - 1) / kSliceBlocks; }

 private:
  static constexpr int64_t kMaxPanels = 8;
};

}  // namespace revisit::engine
