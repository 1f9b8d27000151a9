#pragma once

#include <algorithm>
#include <cstdint>

#include "kernels/blocked/kernels.h"
#include "kernels/convolution.h"
#include "kernels/nchw.h"
#include "kernels/window.h"
#include "layout.h"
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

/// Columns of a matrix product that are summed in registers at a time: with two blocks of output
/// channels, 28 of AVX-512's 32 registers. Targets with fewer registers use fewer columns.
constexpr int64_t kMaxColumns = 14;

struct SumTile {
  int blocks, columns;
};

/// Sums, weights of one input channel and one broadcast value must fit. A block takes `vectors`
/// registers. Enough sums must hide the latency of a fused multiply-add.
constexpr SumTile sum_tile(int registers, int vectors) {
  constexpr int kColumns = kMaxColumns;
  const int blocks = 2 * vectors * (kColumns + 1) + 1 <= registers ? 2 : 1;
  return {blocks, std::clamp((registers - 1) / (blocks * vectors) - 1, 2, kColumns)};
}

/// Columns that are multiplied together: at most `columns`, split at multiples of `unit`.
struct Panel {
  int64_t columns, unit;
};
constexpr Panel kRegisterPanel = {kMaxColumns, 1};

inline Split panels_of(int64_t columns, Panel panel = kRegisterPanel) {
  return {columns, (columns + panel.columns - 1) / panel.columns, panel.unit};
}

/// Partition of columns into chunks that fit the cache.
struct Chunks {
  Split columns;
  bool per_thread;  // true: threads process chunks independently; false: all share each chunk
};

struct Piece {
  int64_t slice, first_panel, end_panel;
};

/// A single thread takes all panels with a slice, so that it reads the slice's weights once.
class Pieces {
 public:
  Pieces(int64_t slices, int64_t panels, int sharing)
      : slices_(slices),
        cut_{panels, std::clamp(kPerThread * (sharing - 1) / slices, int64_t{1}, panels)} {}

  int64_t count() const { return slices_ * cut_.parts; }
  Piece operator[](int64_t i) const {
    const int64_t part = i % cut_.parts;
    return {i / cut_.parts, cut_.begin(part), cut_.end(part)};
  }

 private:
  static constexpr int64_t kPerThread = 2;
  int64_t slices_;
  Split cut_;
};

/// Computes the products of `images` in chunks. For each, calls `product.prepare(image, chunk,
/// item, columns)` for the `product.items(chunk)`, then `product.multiply(image, chunk, piece,
/// columns, thread)` for the pieces. `columns` is the index of the memory of the chunk's columns.
template <class Product>
void run_in_chunks(const Chunks& chunks, int64_t images, int threads, const Product& product) {
  const int64_t parts = chunks.columns.parts;
  if (chunks.per_thread) {
    parallel_for(images * parts, threads, [&](int64_t item, int thread) {
      const int64_t image = item / parts, chunk = item % parts;
      for (int64_t i = 0; i < product.items(chunk); ++i) product.prepare(image, chunk, i, thread);
      const Pieces pieces = product.pieces_of(chunk, 1);
      for (int64_t i = 0; i < pieces.count(); ++i)
        product.multiply(image, chunk, pieces[i], thread, thread);
    });
    return;
  }
  for (int64_t image = 0; image < images; ++image)
    for (int64_t chunk = 0; chunk < parts; ++chunk) {
      parallel_for(product.items(chunk), threads,
                   [&](int64_t i) { product.prepare(image, chunk, i, 0); });
      const Pieces pieces = product.pieces_of(chunk, threads);
      parallel_for(pieces.count(), threads, [&](int64_t i, int thread) {
        product.multiply(image, chunk, pieces[i], 0, thread);
      });
    }
}

/// Splits `products` equal products into chunks of at most `panels` panels. If each thread gets at
/// least one chunk, all get equally many, if there are enough columns.
inline Chunks cut_into_chunks(int64_t products, int64_t columns, int64_t panels, int threads,
                              Panel panel = kRegisterPanel) {
  int64_t chunks = panels_of(columns, panel).parts;
  chunks = (chunks + panels - 1) / panels;
  if (products * chunks < threads) return {{columns, chunks, panel.unit}, false};
  const int64_t most = Split{columns, 1, panel.unit}.units();
  if (products * chunks < 4 * threads)
    while (products * chunks % threads != 0 && chunks < most) ++chunks;
  return {{columns, chunks, panel.unit}, true};
}

/// Rows of an AMX tile, 64 bytes each, and bfloat16 per row. Two tiles are multiplied together.
constexpr int64_t kTileRows = 16, kTileDepth = 32;
constexpr Panel kTilePanel = {2 * kTileRows, kTileRows};

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

/// Input pixels of a row for `outputs` outputs. Strides, kernels and dilations are below 2^31.
inline int64_t plain_input_span(const ConvolutionProblem& p, int64_t outputs) {
  return (outputs - 1) * p.stride_w + (p.kernel_w - 1) * p.dilation_w + 1;
}

/// Products per kernel row: BFloat16 are multiplied in pairs. With an odd number, the last pair
/// repeats its first tap with weight 0.
inline int64_t plain_input_steps(const ConvolutionProblem& p) {
  return p.values == Precision::kBf16 ? (p.kernel_w + 1) / 2 : p.kernel_w;
}

/// Weights per output block; bfloat16 is padded to full tiles for every kernel.
inline int64_t plain_input_weights(const ConvolutionProblem& p) {
  const int64_t steps = p.c_in * p.kernel_h * plain_input_steps(p);
  if (p.values == Precision::kFloat32) return steps * kLanes;
  return Split{2 * steps, 1, kTileDepth}.widest() * kLanes;
}

inline int64_t plain_input_pitch(const ConvolutionProblem& p) {
  return padded_channels(plain_input_span(p, p.out_w));
}

/// Floats that a thread copies: input under a tile at the border or, if rounded, under a row.
inline int64_t plain_input_patch_floats(const ConvolutionProblem& p) {
  return p.c_in * p.kernel_h *
         (p.values == Precision::kBf16 ? plain_input_pitch(p) / 2
                                       : plain_input_span(p, kMaxColumns));
}

/// Floats that a thread unfolds for tiles: the input under a panel of pixels.
inline int64_t plain_input_columns_floats(const ConvolutionProblem& p) {
  return kTilePanel.columns * plain_input_weights(p) / kLanes / 2;
}

/// Returns false for extreme strides and kernels, whose patches would take gigabytes.
inline bool plain_input_patch_fits(const ConvolutionProblem& p) {
  constexpr int64_t kMaxFloats = 1 << 24;
  int64_t floats = 0;
  return !__builtin_mul_overflow(p.c_in * p.kernel_h,
                                 plain_input_span(p, std::max(kMaxColumns, p.out_w)), &floats) &&
         floats <= kMaxFloats;
}

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

/// A piece is a strip of adjacent windows on a band of image rows; one row of its pixels with all
/// channels fits the cache. There are as few strips as the cache permits, because adjacent strips
/// both compute the columns that they share. Each row is computed by one band. Windows that span
/// bands get a maximum from each, merged at the end. The maximum of maxima is bitwise equal, so
/// bands may depend on the number of threads.
struct PoolingPieces {
  int64_t images;
  int64_t windows;    // per strip
  int64_t columns;    // maximum image columns that a strip reads
  int64_t strips;     // per image
  Split bands;        // rows of an image
  int64_t continued;  // maximum rows of windows that reach into a band from above
  int64_t blocks;     // channel blocks
  int threads;

  PoolingPieces(const PoolingProblem& p, int64_t channels, int n_threads)
      : images(p.planes / channels), blocks(channel_blocks(channels)), threads(n_threads) {
    constexpr int64_t kRowFloats = 16384;
    const int64_t wanted = kRowFloats / padded_channels(channels);
    const int64_t most = std::clamp<int64_t>((wanted - p.kernel_w) / p.stride_w + 1, 1, p.out_w);
    windows = ceil_div(p.out_w, ceil_div(p.out_w, most));
    columns = std::min((windows - 1) * p.stride_w + p.kernel_w, p.w);
    strips = ceil_div(p.out_w, windows);
    bands = {p.h, count_bands(p.h)};
    continued = std::min(ceil_div(p.kernel_h - 1, p.stride_h), p.out_h);
  }

  int64_t count() const { return images * strips * bands.parts; }

  int64_t row_floats() const { return columns * blocks * kLanes; }
  int64_t continued_numbers() const { return continued * windows * blocks * kLanes; }
  int64_t scratch_floats() const {
    return images * strips * (bands.parts - 1) * continued_numbers() + threads * row_floats();
  }

 private:
  static int64_t ceil_div(int64_t a, int64_t b) { return (a + b - 1) / b; }

  /// Fewest bands that give all threads nearly equal work.
  int64_t count_bands(int64_t rows) const {
    constexpr int64_t kTried = 4;  // maximum multiple of the fewest bands
    const int64_t fewest = std::clamp<int64_t>(ceil_div(threads, images * strips), 1, rows);
    int64_t best = fewest, best_rows = INT64_MAX;
    for (int64_t n = fewest; n <= std::min(kTried * fewest, rows); ++n) {
      const int64_t rounds = ceil_div(images * strips * n, threads);
      const int64_t rows_of_a_thread = rounds * ceil_div(rows, n);
      if (rows_of_a_thread >= best_rows) continue;
      best = n;
      best_rows = rows_of_a_thread;
    }
    return best;
  }
};

/// Rejects wide windows on many channels, where strips compute the same columns repeatedly.
inline bool is_worth_pooling_in_pieces(const PoolingProblem& p, int64_t channels) {
  const PoolingPieces pieces(p, channels, 1);
  return 2 * pieces.strips * pieces.columns <= 3 * p.w;
}

inline PoolingPieces pieces_of(const ConvolutionMaxPool& p) {
  return {p.pooling, p.convolution.c_out, p.convolution.threads};
}

/// Scratch of one thread in addition to that of the pieces, consecutively.
struct ConvolutionMaxPoolScratch {
  int64_t patch, columns, squares;

  explicit ConvolutionMaxPoolScratch(const ConvolutionMaxPool& p)
      : patch(padded_channels(plain_input_patch_floats(p.convolution))),
        columns(p.in_tiles ? plain_input_columns_floats(p.convolution) : 0),
        squares(p.lrn ? LrnSquares(*p.lrn).floats() : 0) {}

  int64_t floats() const { return patch + columns + squares; }
};

// The list of convolution kernels.

extern const BlockedConvolutionKernel kBlockedPlainInput;
extern const BlockedConvolutionKernel kBlockedPlainInputTiles;
extern const BlockedConvolutionKernel kBlockedDepthwise;
extern const BlockedConvolutionKernel kBlockedNarrowGroups;
extern const BlockedConvolutionKernel kBlockedPointwise;
extern const BlockedConvolutionKernel kBlockedDirect;
extern const BlockedConvolutionKernel kBlockedTiles;
std::span<const BlockedConvolutionKernel> winograd_kernels();

inline bool groups_are_whole_blocks(const ConvolutionProblem& p) {
  return p.group == 1 || (p.c_in_per_group() % kLanes == 0 && p.c_out_per_group() % kLanes == 0);
}

/// Passes `packed` as numbers of type `values` and the conversion from float.
template <class Pack>
void pack_as(Precision values, float* packed, const Pack& pack) {
  if (values == Precision::kBf16)
    pack(reinterpret_cast<BFloat16*>(packed), to_bfloat16);
  else
    pack(packed, [](float x) { return x; });
}

inline bool is_pointwise(const ConvolutionProblem& p) {
  return groups_are_whole_blocks(p) &&
         is_each_pixel({p.h, p.out_h, p.kernel_h, p.stride_h, p.pad_h}) &&
         is_each_pixel({p.w, p.out_w, p.kernel_w, p.stride_w, p.pad_w});
}

// Predicted times of the kernels on one thread, from counts of operations and bytes. The constants
// are for an AVX-512 core at 3.4 GHz with 2 MB of L2 cache (Sapphire Rapids), fitted to measured
// times of the layers in tests/problems/convolution.txt.
double plain_input_ms(const ConvolutionProblem& p);
double plain_input_tiles_ms(const ConvolutionProblem& p);
double depthwise_ms(const ConvolutionProblem& p);
double pointwise_ms(const ConvolutionProblem& p);
double direct_ms(const ConvolutionProblem& p);
double tiles_ms(const ConvolutionProblem& p);
double winograd_ms(const WinogradVariant& v, const ConvolutionProblem& p);

}  // namespace revisit::engine
