#include <algorithm>

#include "kernels/convolution_nd.h"
#include "kernels/gemm.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

/// Output channels per work item: enough rows for an efficient product, independent of the number
/// of threads. Each item owns its output channels, so that no other item adds to them.
int64_t block_channels(const ConvolutionNdProblem& p) {
  constexpr int64_t kRows = 128;
  return std::clamp<int64_t>(kRows / p.kernel_elements(), 1, p.c_image_per_group());
}

/// Windows per fold: their columns fit the L2 cache.
int64_t strip_windows(const ConvolutionNdProblem& p) {
  constexpr int64_t kColumnFloats = 256 * 1024, kLeast = 16;
  const int64_t rows = block_channels(p) * p.kernel_elements();
  return std::min(std::max(kColumnFloats / rows, kLeast), p.windows());
}

int64_t scratch_floats(const ConvolutionNdProblem& p) {
  return p.threads * block_channels(p) * p.kernel_elements() * strip_windows(p);
}

void run(const ConvolutionNdProblem& p, const float* input, const float* weights, const float* bias,
         float* output, float* scratch) {
  const int64_t windows = p.windows(), pixels = p.image_pixels(), taps = p.kernel_elements();
  const int64_t strip = strip_windows(p), block = block_channels(p);
  const int64_t blocks = (p.c_image_per_group() + block - 1) / block;
  parallel_for(p.n * p.group * blocks, p.threads, [&](int64_t item, int thread) {
    const int64_t first_channel = item % blocks * block;
    const int64_t channels = std::min(block, p.c_image_per_group() - first_channel);
    const int64_t group = item / blocks % p.group, n = item / blocks / p.group;
    const int64_t channel = group * p.c_image_per_group() + first_channel;
    const float* in = input + (n * p.c_windows + group * p.c_windows_per_group()) * windows;
    const float* w = weights + group * p.c_windows_per_group() * p.depth() + first_channel * taps;
    float* const out = output + (n * p.c_image + channel) * pixels;
    float* const columns = scratch + thread * block * taps * strip;

    std::fill_n(out, channels * pixels, 0.0F);
    for (int64_t first = 0; first < windows; first += strip) {
      const int64_t count = std::min(strip, windows - first);
      gemm({channels * taps, count, p.c_windows_per_group(), w, p.depth(), in + first, windows,
            false, columns, count, true});
      for (int64_t c = 0; c < channels; ++c)
        for (int64_t k = 0; k < taps; ++k)
          scatter_add_pixels(p.axes, columns + (c * taps + k) * count, k, first, count,
                             out + c * pixels);
    }
    for (int64_t c = 0; bias && c < channels; ++c)
      for (int64_t i = 0; i < pixels; ++i) out[c * pixels + i] += bias[channel + c];
  });
}

/// Index of the window whose kernel element `k` is at `pixel`, in C order; -1 for none.
int64_t window_over(const WindowAxes& axes, int64_t pixel, int64_t k) {
  int64_t window = 0, step = 1;
  for (size_t a = axes.size(); a-- > 0;) {
    const WindowAxis& axis = axes[a];
    const int64_t start = pixel % axis.image + axis.pad - k % axis.kernel * axis.dilation;
    if (start < 0 || start % axis.stride != 0 || start / axis.stride >= axis.windows) return -1;
    window += start / axis.stride * step;
    step *= axis.windows;
    pixel /= axis.image;
    k /= axis.kernel;
  }
  return window;
}

void run_reference(const ConvolutionNdProblem& p, const float* input, const float* weights,
                   const float* bias, float* output, float*) {
  const int64_t windows = p.windows(), pixels = p.image_pixels(), taps = p.kernel_elements();
  for (int64_t n = 0; n < p.n; ++n)
    for (int64_t c = 0; c < p.c_image; ++c)
      for (int64_t pixel = 0; pixel < pixels; ++pixel) {
        const int64_t group = c / p.c_image_per_group(), in_group = c % p.c_image_per_group();
        double sum = 0;
        for (int64_t k = 0; k < taps; ++k) {
          const int64_t window = window_over(p.axes, pixel, k);
          if (window < 0) continue;
          for (int64_t i = 0; i < p.c_windows_per_group(); ++i) {
            const int64_t cw = group * p.c_windows_per_group() + i;
            const double value = input[(n * p.c_windows + cw) * windows + window];
            sum += value * weights[(cw * p.c_image_per_group() + in_group) * taps + k];
          }
        }
        output[(n * p.c_image + c) * pixels + pixel] =
            static_cast<float>(sum + (bias ? bias[c] : 0.0F));
      }
}

}  // namespace

const ConvolutionNdKernel kDeconvolutionGemm = {"gemm-col2im", always, scratch_floats, run, true};
const ConvolutionNdKernel kDeconvolutionReference = {"reference", always, no_scratch,
                                                     run_reference};

}  // namespace revisit::engine
