#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/direct.cpp"
#include <hwy/foreach_target.h>

#include "kernels/blocked/epilogue-inl.h"
#include "kernels/blocked/kernels.h"
#include "kernels/blocked/multiply-inl.h"
#include "kernels/blocked/partition.h"
#include "revisit/engine/parallel_for.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

/// Convolution as a matrix product. The columns of a panel of pixels are copied block by block,
/// which is cheap compared to the product. A pointwise convolution reads them from the input.
template <class T>
class Direct {
 public:
  Direct(const ConvolutionProblem& p, const BlockedConvolutionArguments& a)
      : p_(p),
        a_(a),
        shape_(p, kInTiles<T> ? kTileCut : kRegisterCut),
        reads_input_(!kInTiles<T> && is_pointwise(p)) {}

  void run() const { run_in_chunks(shape_.chunks, shape_.images, p_.threads, *this); }

  int64_t items(int64_t chunk) const {
    return reads_input_ ? 0 : panels_of_chunk(chunk).parts * shape_.in_blocks;
  }

  Pieces pieces_of(int64_t chunk, int sharing) const {
    return {shape_.slices(), panels_of_chunk(chunk).parts, sharing};
  }

  /// Writes [panel][block][tap][pixel][kLanes].
  void prepare(int64_t image, int64_t chunk, int64_t item, int64_t columns) const {
    const Split panels = panels_of_chunk(chunk);
    const int64_t panel = item / shape_.in_blocks, block = item % shape_.in_blocks;
    const T* in = input() + (image * shape_.in_blocks + block) * p_.h * p_.w * kLanes;
    const int64_t width = panels.width(panel), step = columns_step(width);
    const int64_t first = shape_.chunks.columns.begin(chunk) + panels.begin(panel);
    T* const to = columns_at(columns) + panels.begin(panel) * shape_.packed_depth * kLanes;
    const auto at = [&](int64_t depth) {
      return to + depth / kBlocks * step + depth % kBlocks * kLanes;
    };
    int64_t depth = block * shape_.taps;
    for (int64_t ky = 0; ky < p_.kernel_h; ++ky)
      for (int64_t kx = 0; kx < p_.kernel_w; ++kx, ++depth)
        unfold_tap(in, ky, kx, first, width, at(depth));
    if (depth == shape_.depth() && depth % kBlocks != 0) fill_pixels(at(depth), width);
  }

  void multiply(int64_t image, int64_t chunk, const Piece& piece, int64_t columns, int) const {
    const int64_t step = p_.h * p_.w * kLanes;
    if (reads_input_)
      multiply_piece(image, chunk, piece, [&](int64_t first, int64_t) {
        const int64_t pixel = shape_.chunks.columns.begin(chunk) + first;
        return Columns{input() + image * shape_.in_blocks * step + pixel * kLanes, step};
      });
    else
      multiply_piece(image, chunk, piece, [&](int64_t first, int64_t width) {
        return Columns{columns_at(columns) + first * shape_.packed_depth * kLanes,
                       columns_step(width)};
      });
  }

 private:
  const T* input() const { return static_cast<const T*>(a_.input); }
  T* columns_at(int64_t index) const {
    return reinterpret_cast<T*>(a_.scratch) + index * shape_.columns_numbers();
  }

  struct FinishSums {
    const BlockEpilogue* epilogues;
    const T* addend;  // or null
    T* output;
    int64_t step;  // from output block to output block

    template <int kCount>
    HWY_INLINE void operator()(int64_t block, int64_t column, Block (&sums)[kCount]) const {
      const int64_t at = block * step + column * kLanes;
      epilogues[block].finish(sums, addend ? addend + at : nullptr, output + at);
    }
    template <int kBlocks, int kColumns>
    HWY_INLINE void prefetch(int64_t block, int64_t column) const {
      for (int b = 0; b < kBlocks; ++b)
        for (int c = 0; c < kColumns; ++c)
          hwy::Prefetch(output + (block + b) * step + (column + c) * kLanes);
    }
  };

  /// Columns of a panel: [depth][pixel][kLanes], `step` numbers between blocks of the depth. For
  /// tiles, two blocks are combined: [depth / 2][pixel][2][kLanes].
  struct Columns {
    const T* data;
    int64_t step;
  };
  static constexpr int64_t kBlocks = kInTiles<T> ? kTileDepth / kLanes : 1;
  static constexpr int64_t kPixel = kBlocks * kLanes;  // stride of pixels

  Split panels_of_chunk(int64_t chunk) const {
    return panels_of(shape_.chunks.columns.width(chunk), shape_.panel);
  }

  int64_t columns_step(int64_t width) const {
    return Split{width, 1, shape_.panel.unit}.widest() * kPixel;
  }

  static void fill_pixels(T* to, int64_t count) {
    for (int64_t i = 0; i < count; ++i) std::fill_n(to + i * kPixel, kLanes, T{});
  }

  /// Writes zeros outside the image.
  void unfold_tap(const T* in, int64_t ky, int64_t kx, int64_t first, int64_t width, T* to) const {
    int64_t y = first / p_.out_w, x = first % p_.out_w;
    for (int64_t done = 0; done < width; ++y, x = 0) {
      const int64_t run = std::min(p_.out_w - x, width - done);
      const int64_t iy = y * p_.stride_h - p_.pad_h + ky * p_.dilation_h;
      const int64_t ix = x * p_.stride_w - p_.pad_w + kx * p_.dilation_w;
      const bool inside = iy >= 0 && iy < p_.h;
      const int64_t begin =
          inside ? std::clamp<int64_t>((-ix + p_.stride_w - 1) / p_.stride_w, 0, run) : run;
      const int64_t end =
          inside ? std::clamp((p_.w - ix + p_.stride_w - 1) / p_.stride_w, begin, run) : run;
      fill_pixels(to, begin);
      const T* from = in + (iy * p_.w + ix) * kLanes;
      for (int64_t i = begin; i < end; ++i)
        std::copy_n(from + i * p_.stride_w * kLanes, kLanes, to + i * kPixel);
      fill_pixels(to + end * kPixel, run - end);
      to += run * kPixel;
      done += run;
    }
  }

  /// `columns_of(first, width)` returns a panel of the chunk.
  template <class ColumnsOf>
  void multiply_piece(int64_t image, int64_t chunk, const Piece& piece,
                      const ColumnsOf& columns_of) const {
    const int64_t slice = piece.slice;
    const int64_t begin = slice * DirectShape::kSliceBlocks;
    const int64_t blocks = std::min(DirectShape::kSliceBlocks, shape_.out_blocks - begin);
    const int64_t block = image % p_.group * shape_.out_blocks + begin;  // index over all groups
    const int64_t image_step = p_.out_pixels() * kLanes;
    const BlockEpilogue epilogues[] = {
        BlockEpilogue(a_.epilogue, a_.bias, block, p_.c_out),
        BlockEpilogue(a_.epilogue, a_.bias, block + blocks - 1, p_.c_out)};
    const Split panels = panels_of_chunk(chunk);
    [[maybe_unused]] std::conditional_t<kInTiles<T>, Tiles, int> tiles{};
    const auto multiply_part = [&](int64_t first, int64_t end, int64_t b, int64_t count,
                                   int64_t left) HWY_ATTR {
      const int64_t width = end - first;
      const Columns columns = columns_of(first, width);
      const int64_t offset = (image * shape_.out_blocks + begin + b) * image_step +
                             (shape_.chunks.columns.begin(chunk) + first) * kLanes;
      T* const output = static_cast<T*>(a_.output) + offset;
      const T* const addend = a_.addend ? static_cast<const T*>(a_.addend) + offset : nullptr;
      const FinishSums finish = {epilogues + b, addend, output, image_step};
      if constexpr (kInTiles<T>)
        multiply_in_tiles(TileFactors{shape_.packed_depth / kBlocks, columns.data, columns.step,
                                      kPixel, weights(block), shape_.weights()},
                          count, width, tiles, finish);
      else
        HWY_NAMESPACE::multiply(
            Factors<T>{
                shape_.depth(), columns.data, columns.step, weights(block + b), shape_.weights(),
                prefetched(block, slice, b, left),
                columns.data + (reads_input_ ? width * kLanes : shape_.depth() * columns.step),
                reads_input_ ? p_.c_in_per_group() - (shape_.in_blocks - 1) * kLanes : kLanes},
            count, width, finish);
    };
    if (kTileBlocks == 1 && reads_input_)  // a block's weights stay in cache for all columns
      for (int64_t b = 0; b < blocks; ++b)
        multiply_part(panels.begin(piece.first_panel), panels.begin(piece.end_panel), b, 1, b);
    else
      for (int64_t panel = piece.first_panel; panel < piece.end_panel; ++panel)
        multiply_part(panels.begin(panel), panels.end(panel), 0, blocks,
                      piece.end_panel - 1 - panel);
  }

  /// Prefetches for block `b` of a slice and a panel `left` panels before the last. The last panels
  /// each prefetch a block that this thread likely uses next, because those of deep layers are in
  /// L3 or memory.
  const T* prefetched(int64_t block, int64_t slice, int64_t b, int64_t left) const {
    const int64_t next = slice + (shape_.chunks.per_thread ? 1 : p_.threads);
    const int64_t ahead = (next - slice) * DirectShape::kSliceBlocks + left;
    const bool there = left < DirectShape::kSliceBlocks &&
                       slice * DirectShape::kSliceBlocks + ahead < shape_.out_blocks;
    return weights(block + (there ? ahead : b));
  }

  const T* weights(int64_t block) const {
    return reinterpret_cast<const T*>(a_.packed) + block * shape_.weights();
  }

  const ConvolutionProblem& p_;
  const BlockedConvolutionArguments& a_;
  const DirectShape shape_;
  const bool reads_input_;  // its pixels are the columns
};

void run_direct(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
  with_type(p.values, [&](auto type) { Direct<decltype(type)>(p, a).run(); });
}

void run_in_tiles(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
  Direct<TileBf16>(p, a).run();
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {
namespace {

HWY_EXPORT(run_direct);
HWY_EXPORT(run_in_tiles);

int64_t packed_numbers(const ConvolutionProblem& p) {
  const DirectShape shape(p);
  return p.group * shape.out_blocks * shape.weights();
}

/// Writes [output block][input block][tap][input channel / step][kLanes][step], with zeros from the
/// depth to the packed depth.
template <class T, class Convert>
void pack(const ConvolutionProblem& p, const float* weights, T* packed, const Convert& convert) {
  constexpr int64_t kStep = std::is_same_v<T, float> ? 1 : 2;
  const DirectShape shape(p);
  const int64_t in_per_group = p.c_in_per_group(), out_per_group = p.c_out_per_group();
  parallel_for(p.group * shape.out_blocks, p.threads, [&](int64_t item, int) {
    const int64_t group = item / shape.out_blocks, first = item % shape.out_blocks * kLanes;
    T* to = packed + item * shape.weights();
    for (int64_t block = 0; block < shape.in_blocks; ++block)
      for (int64_t tap = 0; tap < shape.taps; ++tap)
        for (int64_t i = 0; i < kLanes * kLanes; ++i) {
          const int64_t step = i / (kLanes * kStep), co = first + i / kStep % kLanes;
          const int64_t ci = block * kLanes + step * kStep + i % kStep;
          const int64_t from =
              ((group * out_per_group + co) * in_per_group + ci) * shape.taps + tap;
          *to++ = ci < in_per_group && co < out_per_group ? convert(weights[from]) : T{};
        }
    std::fill(to, packed + (item + 1) * shape.weights(), T{});
  });
}

int64_t unfolded_floats(const ConvolutionProblem& p, const DirectShape& shape) {
  return (shape.chunks.per_thread ? p.threads : 1) * shape.columns_numbers() *
         value_bytes(p.values) / value_bytes(Precision::kFloat32);
}

void run_direct_here(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
  REVISIT_DISPATCH(run_direct, instructions_for(p.values))(p, a);
}

constexpr BlockedConvolutionKernel direct(const char* name,
                                          bool (*supports)(const ConvolutionProblem&),
                                          double (*predicted_ms)(const ConvolutionProblem&),
                                          int64_t (*scratch_floats)(const ConvolutionProblem&),
                                          void (*run)(const ConvolutionProblem&,
                                                      const BlockedConvolutionArguments&),
                                          Products products = Products::kValues) {
  return {name,
          Layout::kNChw16c,
          supports,
          predicted_ms,
          [](const ConvolutionProblem& p) {
            return packed_numbers(p) * value_bytes(p.values) / value_bytes(Precision::kFloat32);
          },
          [](const ConvolutionProblem& p, const float* weights, float* packed) {
            pack_as(p.values, packed,
                    [&](auto* to, const auto& convert) { pack(p, weights, to, convert); });
          },
          scratch_floats,
          run,
          0,
          products};
}

}  // namespace

const BlockedConvolutionKernel kBlockedDirect = direct(
    "direct", groups_are_whole_blocks, direct_ms,
    [](const ConvolutionProblem& p) {
      return is_pointwise(p) ? 0 : unfolded_floats(p, DirectShape(p));
    },
    run_direct_here);

const BlockedConvolutionKernel kBlockedPointwise = direct(
    "pointwise", is_pointwise, pointwise_ms, [](const ConvolutionProblem&) { return int64_t{0}; },
    run_direct_here);

const BlockedConvolutionKernel kBlockedTiles = direct(
    "tiles",
    [](const ConvolutionProblem& p) {
      return p.values == Precision::kBf16 && groups_are_whole_blocks(p);
    },
    tiles_ms,
    [](const ConvolutionProblem& p) { return unfolded_floats(p, DirectShape(p, kTileCut)); },
    [](const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
      REVISIT_DISPATCH(run_in_tiles, Instructions::kTiles)(p, a);
    },
    Products::kTiles);

}  // namespace revisit::engine
#endif
