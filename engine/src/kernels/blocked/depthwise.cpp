#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/depthwise.cpp"
#include <hwy/foreach_target.h>  // includes this file again for every target

#include "kernels/blocked/convolution.h"
#include "kernels/blocked/convolution_list.h"
#include "kernels/blocked/cost_model.h"
#include "kernels/blocked/epilogue-inl.h"
#include "kernels/parallel.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

/// The taps [first, end) of a window that meet the image, along one axis.
struct Taps {
  int64_t first, end;
};

inline Taps taps_inside(int64_t start, int64_t size, int64_t kernel, int64_t dilation) {
  const int64_t first = std::clamp<int64_t>((-start + dilation - 1) / dilation, 0, kernel);
  return {first, std::clamp((size - start + dilation - 1) / dilation, first, kernel)};
}

/// One filter a channel: as many independent products as there are channels.
template <class T>
class Depthwise {
 public:
  Depthwise(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) : p_(p), a_(a) {}

  void run() const {
    parallel_for(p_.n * channel_blocks(p_.c_out) * p_.out_h, p_.threads,
                 [&](int64_t item, int) { run_row(item / p_.out_h, item % p_.out_h); });
  }

 private:
  static constexpr int kPixels = kVectors == 1 ? 8 : 4;

  /// `plane` counts the blocks of all images.
  void run_row(int64_t plane, int64_t y) const {
    const int64_t block = plane % channel_blocks(p_.c_out);
    const BlockEpilogue epilogue(a_.epilogue, a_.bias, block, p_.c_out);
    const int64_t y0 = y * p_.stride_h - p_.pad_h;
    const Taps rows = taps_inside(y0, p_.h, p_.kernel_h, p_.dilation_h);
    const T* in = static_cast<const T*>(a_.input) + plane * p_.h * p_.w * kLanes;
    const float* weights = a_.packed + block * p_.kernel_h * p_.kernel_w * kLanes;
    const int64_t offset = (plane * p_.out_h + y) * p_.out_w * kLanes;
    const auto finish = [&](int64_t x, const Block& sum) HWY_ATTR {
      const int64_t at = offset + x * kLanes;
      const auto* addend = static_cast<const T*>(a_.addend);
      epilogue.finish(sum, addend ? addend + at : nullptr, static_cast<T*>(a_.output) + at);
    };
    for (int64_t x = 0; x < p_.out_w;) {
      const int64_t x0 = x * p_.stride_w - p_.pad_w;
      const int64_t last = x0 + (kPixels - 1) * p_.stride_w + (p_.kernel_w - 1) * p_.dilation_w;
      if (x0 >= 0 && last < p_.w && x + kPixels <= p_.out_w) {
        Block sums[kPixels];
        accumulate<kPixels>(in, weights, y0, x0, rows, {0, p_.kernel_w}, sums);
        REVISIT_UNROLL
        for (int i = 0; i < kPixels; ++i) finish(x + i, sums[i]);
        x += kPixels;
      } else {
        Block sum[1];
        accumulate<1>(in, weights, y0, x0, rows, taps_inside(x0, p_.w, p_.kernel_w, p_.dilation_w),
                      sum);
        finish(x++, sum[0]);
      }
    }
  }

  /// Pixels `stride_w` apart from input column `x0` on, over taps inside the image for all of them.
  template <int kCount>
  HWY_INLINE void accumulate(const T* in, const float* weights, int64_t y0, int64_t x0, Taps rows,
                             Taps columns, Block (&sums)[kCount]) const {
    REVISIT_UNROLL
    for (int i = 0; i < kCount; ++i) sums[i] = zero_block();
    for (int64_t ky = rows.first; ky < rows.end; ++ky)
      for (int64_t kx = columns.first; kx < columns.end; ++kx) {
        const Block w = load_block(weights + (ky * p_.kernel_w + kx) * kLanes);
        const T* from = in + ((y0 + ky * p_.dilation_h) * p_.w + x0 + kx * p_.dilation_w) * kLanes;
        REVISIT_UNROLL
        for (int i = 0; i < kCount; ++i)
          sums[i] = mul_add(load_block(from + i * p_.stride_w * kLanes), w, sums[i]);
      }
  }

  const ConvolutionProblem& p_;
  const BlockedConvolutionArguments& a_;
};

void run_depthwise(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
  with_type(p.values, [&](auto type) { Depthwise<decltype(type)>(p, a).run(); });
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {
namespace {

HWY_EXPORT(run_depthwise);

/// Writes [block][tap][kLanes].
void pack(const ConvolutionProblem& p, const float* weights, float* packed) {
  const int64_t taps = p.kernel_h * p.kernel_w;
  for (int64_t block = 0; block < channel_blocks(p.c_out); ++block)
    for (int64_t tap = 0; tap < taps; ++tap)
      for (int64_t c = block * kLanes; c < (block + 1) * kLanes; ++c)
        *packed++ = c < p.c_out ? weights[c * taps + tap] : 0.0F;
}

}  // namespace

const BlockedConvolutionKernel kBlockedDepthwise = {
    "depthwise",
    Layout::kNChw16c,
    [](const ConvolutionProblem& p) { return p.group == p.c_in && p.group == p.c_out; },
    depthwise_ms,
    [](const ConvolutionProblem& p) { return padded_channels(p.c_out) * p.kernel_h * p.kernel_w; },
    pack,
    [](const ConvolutionProblem&) { return int64_t{0}; },
    [](const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
      HWY_DYNAMIC_DISPATCH(run_depthwise)(p, a);
    }};

}  // namespace revisit::engine
#endif
