#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/plain_input.cpp"
#include <hwy/foreach_target.h>  // includes this file again for every target

#include <cstring>

#include "kernels/blocked/convolution.h"
#include "kernels/blocked/cost_model.h"
#include "kernels/blocked/epilogue-inl.h"
#include "kernels/blocked/kernels.h"
#include "kernels/blocked/multiply-inl.h"
#include "kernels/parallel.h"

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
class PlainInput {
 public:
  PlainInput(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) : p_(p), a_(a) {}

  void run() const {
    switch (p_.stride_w) {
      case 1:
        return run_rows<1>();
      case 2:
        return run_rows<2>();
      case 4:
        return run_rows<4>();
      default:
        return run_rows<0>();
    }
  }

 private:
  static constexpr int kPixels = kTileColumns;

  int64_t weights_step() const { return p_.depth() * kLanes; }
  int64_t span(int64_t pixels) const {
    return (pixels - 1) * p_.stride_w + (p_.kernel_w - 1) * p_.dilation_w + 1;
  }

  template <int kStride>
  void run_rows() const {
    const int64_t patch_floats = p_.c_in * p_.kernel_h * span(kPixels);
    parallel_for(p_.n * p_.out_h, p_.threads, [&](int64_t item, int thread) {
      float* const patch = a_.scratch + thread * patch_floats;
      for (int64_t block = 0; block < channel_blocks(p_.c_out); block += kTileBlocks) {
        if (kTileBlocks > 1 && block + 1 < channel_blocks(p_.c_out))
          run_row<kTileBlocks, kStride>(item / p_.out_h, item % p_.out_h, block, patch);
        else
          run_row<1, kStride>(item / p_.out_h, item % p_.out_h, block, patch);
      }
    });
  }

  /// The last tile of a row overlaps the one before it rather than being narrower.
  template <int kBlocks, int kStride>
  void run_row(int64_t n, int64_t y, int64_t block, float* patch) const {
    const int64_t last = p_.out_w - kPixels;
    for (int64_t x = 0; x < last + kPixels; x += kPixels)
      if (last >= 0) {
        run_tile<kBlocks, kPixels, kStride>(n, y, std::min(x, last), block, patch);
      } else {
        for (int64_t i = 0; i < p_.out_w; ++i) run_tile<kBlocks, 1, kStride>(n, y, i, block, patch);
      }
  }

  template <int kBlocks, int kTile, int kStride>
  void run_tile(int64_t n, int64_t y, int64_t x, int64_t block, float* patch) const {
    const InputView view = view_of(n, y, x, kTile, patch);
    Block sums[kBlocks][kTile];
    accumulate<kBlocks, kTile, kStride>(view, a_.packed + block * weights_step(), sums);
    REVISIT_UNROLL
    for (int b = 0; b < kBlocks; ++b) {
      const BlockEpilogue epilogue(a_.epilogue, a_.bias, block + b, p_.c_out);
      const int64_t at =
          (((n * channel_blocks(p_.c_out) + block + b) * p_.out_h + y) * p_.out_w + x) * kLanes;
      REVISIT_UNROLL
      for (int i = 0; i < kTile; ++i)
        epilogue.finish(sums[b][i], a_.addend ? a_.addend + at + i * kLanes : nullptr,
                        a_.output + at + i * kLanes);
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

  /// Into the image itself, or into `patch` where the tile reaches over its left or right border.
  InputView view_of(int64_t n, int64_t y, int64_t x, int64_t pixels, float* patch) const {
    const int64_t y0 = y * p_.stride_h - p_.pad_h, x0 = x * p_.stride_w - p_.pad_w;
    const int64_t d = p_.dilation_h;
    const int64_t first_ky = std::clamp<int64_t>((-y0 + d - 1) / d, 0, p_.kernel_h);
    const int64_t end_ky = std::clamp((p_.h - y0 + d - 1) / d, first_ky, p_.kernel_h);
    const float* image = a_.input + n * p_.c_in * p_.h * p_.w;
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

void run_plain_input(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
  PlainInput(p, a).run();
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {
namespace {

HWY_EXPORT(run_plain_input);

/// Writes [output block][input channel][tap][kLanes].
void pack(const ConvolutionProblem& p, const float* weights, float* packed) {
  for (int64_t block = 0; block < channel_blocks(p.c_out); ++block)
    for (int64_t k = 0; k < p.depth(); ++k)
      for (int64_t co = block * kLanes; co < (block + 1) * kLanes; ++co)
        *packed++ = co < p.c_out ? weights[co * p.depth() + k] : 0.0F;
}

}  // namespace

const BlockedConvolutionKernel kBlockedPlainInput = {
    "direct plain-input",
    Layout::kPlain,
    [](const ConvolutionProblem& p) { return p.c_in <= 4 && p.group == 1; },
    plain_input_ms,
    [](const ConvolutionProblem& p) { return padded_channels(p.c_out) * p.depth(); },
    pack,
    [](const ConvolutionProblem& p) {
      const int64_t span = (kMaxColumns - 1) * p.stride_w + (p.kernel_w - 1) * p.dilation_w + 1;
      return p.threads * p.c_in * p.kernel_h * span;
    },
    [](const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
      HWY_DYNAMIC_DISPATCH(run_plain_input)(p, a);
    }};

}  // namespace revisit::engine
#endif
