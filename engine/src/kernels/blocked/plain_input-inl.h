// Computes one row of output pixels at a time. Included once per target.
#if defined(REVISIT_PLAIN_INPUT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_PLAIN_INPUT_INL_H_
#undef REVISIT_PLAIN_INPUT_INL_H_
#else
#define REVISIT_PLAIN_INPUT_INL_H_
#endif

#include "kernels/blocked/epilogue-inl.h"
#include "kernels/blocked/kernels.h"
#include "kernels/blocked/multiply-inl.h"
#include "kernels/blocked/partition.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

/// Starts at the first row inside the image. Kernel rows [first_ky, end_ky) are inside.
template <class In>
struct InputView {
  const In* data;
  int64_t channel_step, row_step;
  int64_t first_ky, end_ky;
};

/// Broadcasts input values as they are read, BFloat16 as two neighbors of a row.
template <class In>
class PlainInput {
 public:
  PlainInput(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) : p_(p), a_(a) {}

  /// Output pixels [begin, end) of one row of an image, from block 0.
  struct Row {
    int64_t n, y, begin, end;
    void* output;
    Precision values;     // type of output and addend; kFloat32 if `In` is float
    int64_t output_step;  // stride of blocks
    const void* addend;   // with the output's strides; or null
    float* patch;         // scratch: plain_input_patch_floats()
    float* columns;       // scratch for tiles: plain_input_columns_floats(); or null
  };

  void run_row(const Row& row) const {
    if constexpr (!kReadsImage) round_input(row);
    if constexpr (kInTiles<In>)
      return run_in_tiles(row);
    else
      switch (p_.stride_w) {
        case 1:
          return run_blocks<1>(row);
        case 2:
          return run_blocks<2>(row);
        case 4:
          return run_blocks<4>(row);
        default:
          return run_blocks<0>(row);
      }
  }

 private:
  static constexpr int kPixels = kTileColumns;
  static constexpr bool kReadsImage = std::is_same_v<In, float>;

  int64_t weights_step() const { return plain_input_weights(p_); }

  const In* weights(int64_t block) const {
    return reinterpret_cast<const In*>(a_.packed) + block * weights_step();
  }

  void run_in_tiles(const Row& row) const {
    In* const columns = reinterpret_cast<In*>(row.columns);
    const int64_t depth = weights_step() / kLanes, blocks = channel_blocks(p_.c_out);
    Tiles tiles;
    for (int64_t x = row.begin; x < row.end; x += kTilePanel.columns) {
      const int64_t pixels = std::min(kTilePanel.columns, row.end - x);
      const InputView<In> view = view_of(row, x, pixels);
      for (int64_t i = 0; i < pixels; ++i)
        unfold_pixel(view, i * p_.stride_w, depth, columns + i * depth);
      for (int64_t block = 0; block < blocks; block += 2)
        multiply_in_tiles(TileFactors{depth / kTileDepth, columns, kTileDepth, depth,
                                      weights(block), weights_step()},
                          std::min<int64_t>(2, blocks - block), pixels, tiles,
                          [&](int64_t b, int64_t first, auto& sums)
                              HWY_ATTR { finish(row, view, x + first, block + b, sums); });
    }
  }

  /// Copies the input under one pixel, in the order of the weights.
  void unfold_pixel(const InputView<In>& view, int64_t x, int64_t depth, In* to) const {
    const int64_t pairs = plain_input_steps(p_), width = 2 * pairs;
    const In* const end = to + depth;
    for (int64_t c = 0; c < p_.c_in; ++c) {
      const In* from = view.data + c * view.channel_step + x;
      for (int64_t ky = 0; ky < p_.kernel_h; ++ky, to += width) {
        if (ky < view.first_ky || ky >= view.end_ky) {
          std::fill_n(to, width, In{});
          continue;
        }
        std::copy_n(from, width - 2, to);
        std::copy_n(from + p_.kernel_w - 2, 2, to + width - 2);
        from += view.row_step;
      }
    }
    std::fill_n(to, end - to, In{});
  }

  template <int kStride>
  void run_blocks(const Row& row) const {
    for (int64_t block = 0; block < channel_blocks(p_.c_out); block += kTileBlocks) {
      if constexpr (kTileBlocks > 1)
        if (block + 1 < channel_blocks(p_.c_out)) {
          run_tiles<kTileBlocks, kStride>(row, block);
          continue;
        }
      run_tiles<1, kStride>(row, block);
    }
  }

  /// The last tile of a row overlaps the previous one, so that all have the same width.
  template <int kBlocks, int kStride>
  void run_tiles(const Row& row, int64_t block) const {
    const int64_t last = row.end - kPixels;
    if (last >= row.begin)
      for (int64_t x = row.begin; x < row.end; x += kPixels)
        run_tile<kBlocks, kPixels, kStride>(row, std::min(x, last), block);
    else
      for (int64_t x = row.begin; x < row.end; ++x) run_tile<kBlocks, 1, 0>(row, x, block);
  }

  template <int kBlocks, int kTile, int kStride>
  void run_tile(const Row& row, int64_t x, int64_t block) const {
    const InputView<In> view = view_of(row, x, kTile);
    Block sums[kBlocks][kTile];
    accumulate<kBlocks, kTile, kStride>(view, weights(block), sums);
    REVISIT_UNROLL
    for (int b = 0; b < kBlocks; ++b) finish(row, view, x, block + b, sums[b]);
  }

  template <int kCount>
  HWY_NOINLINE void finish(const Row& row, const InputView<In>& view, int64_t x, int64_t block,
                           Block (&sums)[kCount]) const {
    if (a_.outside_taps && reaches_outside(view, x, kCount)) add_outside(view, x, block, sums);
    if constexpr (!kReadsImage)
      if (row.values == Precision::kBf16) return finish_as<BFloat16>(row, x, block, sums);
    finish_as<float>(row, x, block, sums);
  }

  template <class Out, int kCount>
  HWY_INLINE void finish_as(const Row& row, int64_t x, int64_t block, Block (&sums)[kCount]) const {
    const BlockEpilogue epilogue(a_.epilogue, a_.bias, block, p_.c_out);
    const auto* const addend = static_cast<const Out*>(row.addend);
    const int64_t at = block * row.output_step + (x - row.begin) * kLanes;
    epilogue.finish(sums, addend ? addend + at : nullptr, static_cast<Out*>(row.output) + at);
  }

  template <int kBlocks, int kTile, int kStride>
  HWY_INLINE void accumulate(const InputView<In>& view, const In* weights,
                             Block (&result)[kBlocks][kTile]) const {
    const int64_t stride = kStride > 0 ? kStride : p_.stride_w, step = weights_step();
    const int64_t steps = plain_input_steps(p_), last = p_.kernel_w - kStep<In>;
    Block sums[kBlocks][kTile];  // never addressed, so that they stay in registers
    REVISIT_UNROLL
    for (int b = 0; b < kBlocks; ++b) {
      REVISIT_UNROLL
      for (int i = 0; i < kTile; ++i) sums[b][i] = zero_block();
    }
    const int64_t rows = view.end_ky - view.first_ky, row_weights = steps * kStep<In> * kLanes;
    const In* row = view.data;
    const In* w = weights + view.first_ky * row_weights;
    // One loop over channels, rows and steps, because nested loops would spill the sums.
    for (int64_t n = p_.c_in * rows * steps, s = 0, y = 0; n > 0; --n, w += kStep<In> * kLanes) {
      const In* in = row + std::min(s * kStep<In>, last) * p_.dilation_w;
      Block factors[kBlocks];
      REVISIT_UNROLL
      for (int b = 0; b < kBlocks; ++b) factors[b] = load_weights(w + b * step);
      REVISIT_UNROLL
      for (int i = 0; i < kTile; ++i) add_column(in + i * stride, factors, i, sums);
      if (++s < steps) continue;
      s = 0;
      row += view.row_step;
      if (++y < rows) continue;
      y = 0;
      row += view.channel_step - rows * view.row_step;
      w += (p_.kernel_h - rows) * row_weights;
    }
    REVISIT_UNROLL
    for (int b = 0; b < kBlocks; ++b) {
      REVISIT_UNROLL
      for (int i = 0; i < kTile; ++i) result[b][i] = sums[b][i];
    }
  }

  bool reaches_outside(const InputView<In>& view, int64_t x, int64_t pixels) const {
    const int64_t x0 = x * p_.stride_w - p_.pad_w;
    return view.first_ky > 0 || view.end_ky < p_.kernel_h || x0 < 0 ||
           x0 + plain_input_span(p_, pixels) > p_.w;
  }

  template <int kCount>
  void add_outside(const InputView<In>& view, int64_t x, int64_t block,
                   Block (&sums)[kCount]) const {
    const float* const taps = a_.outside_taps + block * p_.depth() * kLanes;
    for (int i = 0; i < kCount; ++i)
      for (int64_t ky = 0; ky < p_.kernel_h; ++ky)
        for (int64_t kx = 0; kx < p_.kernel_w; ++kx) {
          const int64_t ix = (x + i) * p_.stride_w - p_.pad_w + kx * p_.dilation_w;
          const bool inside = ky >= view.first_ky && ky < view.end_ky && ix >= 0 && ix < p_.w;
          if (inside) continue;
          sums[i] = sums[i] + load_block(taps + (ky * p_.kernel_w + kx) * kLanes);
        }
  }

  /// Copies to the patch if the tile crosses the left or right border. BFloat16 is always in the
  /// patch, filled by round_input().
  InputView<In> view_of(const Row& row, int64_t x, int64_t pixels) const {
    if constexpr (kReadsImage) {
      InputView<In> view = rows_inside(row);
      const int64_t x0 = x * p_.stride_w - p_.pad_w, width = plain_input_span(p_, pixels);
      view.data += x0;
      if (x0 >= 0 && x0 + width <= p_.w) return view;
      return copy(
          view, x0, width, width, row.patch,
          [](const float* from, int64_t count, float* to) { std::copy_n(from, count, to); });
    } else {
      const int64_t pitch = plain_input_pitch(p_);
      const InputView<float> view = rows_inside(row);
      return {reinterpret_cast<const In*>(row.patch) + (x - row.begin) * p_.stride_w,
              (view.end_ky - view.first_ky) * pitch, pitch, view.first_ky, view.end_ky};
    }
  }

  void round_input(const Row& row) const {
    InputView<float> view = rows_inside(row);
    const int64_t x0 = row.begin * p_.stride_w - p_.pad_w;
    view.data += x0;
    copy(view, x0, plain_input_span(p_, row.end - row.begin), plain_input_pitch(p_),
         reinterpret_cast<In*>(row.patch), [](const float* from, int64_t count, In* to) HWY_ATTR {
           int64_t i = 0;
           for (; i + kVectorLanes <= count; i += kVectorLanes)
             store_vector(hn::LoadU(Tag(), from + i), to + i);
           for (; i < count; ++i) to[i].bits = to_bfloat16(from[i]).bits;
         });
  }

  /// View of the input under an output row, from column 0 of the image.
  InputView<float> rows_inside(const Row& row) const {
    const int64_t y0 = row.y * p_.stride_h - p_.pad_h, d = p_.dilation_h;
    const int64_t first_ky = std::clamp<int64_t>((-y0 + d - 1) / d, 0, p_.kernel_h);
    const int64_t end_ky = std::clamp((p_.h - y0 + d - 1) / d, first_ky, p_.kernel_h);
    const float* image = static_cast<const float*>(a_.input) + row.n * p_.c_in * p_.h * p_.w;
    return {image + (y0 + first_ky * d) * p_.w, p_.h * p_.w, d * p_.w, first_ky, end_ky};
  }

  /// Copies `width` columns from `x0` to `to`, with rows `pitch` apart; zeros outside the image.
  template <class T, class Copy>
  InputView<T> copy(const InputView<float>& view, int64_t x0, int64_t width, int64_t pitch, T* to,
                    const Copy& copy_run) const {
    const int64_t begin = std::clamp<int64_t>(-x0, 0, width);
    const int64_t end = std::clamp(p_.w - x0, begin, width);
    const int64_t rows = view.end_ky - view.first_ky;
    for (int64_t c = 0; c < p_.c_in; ++c)
      for (int64_t i = 0; i < rows; ++i) {
        const float* from = view.data + c * view.channel_step + i * view.row_step;
        T* const row = to + (c * rows + i) * pitch;
        std::fill(row, row + begin, T{});
        copy_run(from + begin, end - begin, row + begin);
        std::fill(row + end, row + width, T{});
      }
    return {to, rows * pitch, pitch, view.first_ky, view.end_ky};
  }

  const ConvolutionProblem& p_;
  const BlockedConvolutionArguments& a_;
};

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
