// Convolution of few channels, plain input, a row of output pixels at a time. Highway includes this
// file once per target.
#if defined(REVISIT_PLAIN_INPUT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_PLAIN_INPUT_INL_H_
#undef REVISIT_PLAIN_INPUT_INL_H_
#else
#define REVISIT_PLAIN_INPUT_INL_H_
#endif

#include "kernels/blocked/convolution.h"
#include "kernels/blocked/epilogue-inl.h"
#include "kernels/blocked/multiply-inl.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

/// The input under a tile of pixels of one output row: its first row inside the image, its steps in
/// floats, and the rows of the kernel that meet the image.
struct InputView {
  const float* data;
  int64_t channel_step, row_step;
  int64_t first_ky, end_ky;
};

/// A convolution of few channels, one plane each: every input value is broadcast as it is read.
/// Its output is of T.
template <class T>
class PlainInput {
 public:
  PlainInput(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) : p_(p), a_(a) {}

  /// The output pixels [begin, end) of one row of an image, from block 0 on.
  struct Row {
    int64_t n, y, begin, end;
    T* output;
    int64_t output_step;  // from block to block
    const T* addend;      // steps as output's; or null
    float* patch;         // scratch: plain_input_patch_floats()
  };

  void run_row(const Row& row) const {
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

  int64_t weights_step() const { return p_.depth() * kLanes; }
  int64_t span(int64_t pixels) const {
    return (pixels - 1) * p_.stride_w + (p_.kernel_w - 1) * p_.dilation_w + 1;
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

  /// The last tile of a row overlaps the one before it rather than being narrower.
  template <int kBlocks, int kStride>
  void run_tiles(const Row& row, int64_t block) const {
    const int64_t last = row.end - kPixels;
    if (last >= row.begin)
      for (int64_t x = row.begin; x < row.end; x += kPixels)
        run_tile<kBlocks, kPixels, kStride>(row, std::min(x, last), block);
    else
      for (int64_t x = row.begin; x < row.end; ++x) run_tile<kBlocks, 1, kStride>(row, x, block);
  }

  template <int kBlocks, int kTile, int kStride>
  void run_tile(const Row& row, int64_t x, int64_t block) const {
    const InputView view = view_of(row.n, row.y, x, kTile, row.patch);
    Block sums[kBlocks][kTile];
    accumulate<kBlocks, kTile, kStride>(view, a_.packed + block * weights_step(), sums);
    if (a_.outside_taps && reaches_outside(view, x, kTile)) add_outside(view, x, block, sums);
    REVISIT_UNROLL
    for (int b = 0; b < kBlocks; ++b) {
      const BlockEpilogue epilogue(a_.epilogue, a_.bias, block + b, p_.c_out);
      const int64_t at = (block + b) * row.output_step + (x - row.begin) * kLanes;
      REVISIT_UNROLL
      for (int i = 0; i < kTile; ++i)
        epilogue.finish(sums[b][i], row.addend ? row.addend + at + i * kLanes : nullptr,
                        row.output + at + i * kLanes);
    }
  }

  template <int kBlocks, int kTile, int kStride>
  HWY_INLINE void accumulate(const InputView& view, const float* weights,
                             Block (&sums)[kBlocks][kTile]) const {
    const Tag d;
    const int64_t stride = kStride > 0 ? kStride : p_.stride_w, step = weights_step();
    REVISIT_UNROLL
    for (int b = 0; b < kBlocks; ++b) {
      REVISIT_UNROLL
      for (int i = 0; i < kTile; ++i) sums[b][i] = zero_block();
    }
    for (int64_t c = 0; c < p_.c_in; ++c)
      for (int64_t ky = view.first_ky; ky < view.end_ky; ++ky) {
        const float* in = view.data + c * view.channel_step + (ky - view.first_ky) * view.row_step;
        const float* w = weights + (c * p_.kernel_h + ky) * p_.kernel_w * kLanes;
        for (int64_t kx = 0; kx < p_.kernel_w; ++kx, in += p_.dilation_w, w += kLanes) {
          Block factors[kBlocks];
          REVISIT_UNROLL
          for (int b = 0; b < kBlocks; ++b) factors[b] = load_block(w + b * step);
          REVISIT_UNROLL
          for (int i = 0; i < kTile; ++i) {
            const Vector value = hn::Set(d, in[i * stride]);
            REVISIT_UNROLL
            for (int b = 0; b < kBlocks; ++b) sums[b][i] = mul_add(value, factors[b], sums[b][i]);
          }
        }
      }
  }

  bool reaches_outside(const InputView& view, int64_t x, int64_t pixels) const {
    const int64_t x0 = x * p_.stride_w - p_.pad_w;
    return view.first_ky > 0 || view.end_ky < p_.kernel_h || x0 < 0 || x0 + span(pixels) > p_.w;
  }

  template <int kBlocks, int kTile>
  void add_outside(const InputView& view, int64_t x, int64_t block,
                   Block (&sums)[kBlocks][kTile]) const {
    for (int i = 0; i < kTile; ++i)
      for (int64_t ky = 0; ky < p_.kernel_h; ++ky)
        for (int64_t kx = 0; kx < p_.kernel_w; ++kx) {
          const int64_t ix = (x + i) * p_.stride_w - p_.pad_w + kx * p_.dilation_w;
          const bool inside = ky >= view.first_ky && ky < view.end_ky && ix >= 0 && ix < p_.w;
          if (inside) continue;
          for (int b = 0; b < kBlocks; ++b)
            sums[b][i] = sums[b][i] + load_block(a_.outside_taps + (block + b) * weights_step() +
                                                 (ky * p_.kernel_w + kx) * kLanes);
        }
  }

  /// Into the image itself, or into `patch` where the tile reaches over its left or right border.
  InputView view_of(int64_t n, int64_t y, int64_t x, int64_t pixels, float* patch) const {
    const int64_t y0 = y * p_.stride_h - p_.pad_h, x0 = x * p_.stride_w - p_.pad_w;
    const int64_t d = p_.dilation_h;
    const int64_t first_ky = std::clamp<int64_t>((-y0 + d - 1) / d, 0, p_.kernel_h);
    const int64_t end_ky = std::clamp((p_.h - y0 + d - 1) / d, first_ky, p_.kernel_h);
    const float* image = static_cast<const float*>(a_.input) + n * p_.c_in * p_.h * p_.w;
    const int64_t width = span(pixels);
    if (x0 >= 0 && x0 + width <= p_.w)
      return {image + (y0 + first_ky * d) * p_.w + x0, p_.h * p_.w, d * p_.w, first_ky, end_ky};
    const int64_t begin = std::clamp<int64_t>(-x0, 0, width);
    const int64_t end = std::clamp(p_.w - x0, begin, width);
    float* to = patch;
    for (int64_t c = 0; c < p_.c_in; ++c)
      for (int64_t ky = first_ky; ky < end_ky; ++ky, to += width) {
        const float* row = image + (c * p_.h + y0 + ky * d) * p_.w;
        std::fill(to, to + begin, 0.0F);
        std::copy(row + x0 + begin, row + x0 + end, to + begin);
        std::fill(to + end, to + width, 0.0F);
      }
    return {patch, (end_ky - first_ky) * width, width, first_ky, end_ky};
  }

  const ConvolutionProblem& p_;
  const BlockedConvolutionArguments& a_;
};

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
