#include "kernels/convolution_nd.h"

#include <algorithm>

#include "kernels/gemm.h"
#include "kernels/parallel.h"

namespace revisit::engine {
namespace {

/// Windows unfolded at a time: few enough that the columns stay in the L2 cache.
int64_t strip_windows(const ConvolutionNdProblem& p) {
  constexpr int64_t kColumnFloats = 256 * 1024, kLeast = 16;
  return std::min(std::max(kColumnFloats / p.depth(), kLeast), p.windows());
}

int64_t scratch_floats(const ConvolutionNdProblem& p) {
  return p.threads * p.depth() * strip_windows(p);
}

void run(const ConvolutionNdProblem& p, const float* input, const float* weights, const float* bias,
         float* output, float* scratch) {
  const int64_t windows = p.windows(), pixels = p.image_pixels(), taps = p.kernel_elements();
  const int64_t strip = strip_windows(p), strips = (windows + strip - 1) / strip;
  const int64_t channels = p.c_windows_per_group();
  parallel_for(p.n * p.group * strips, p.threads, [&](int64_t item, int thread) {
    const int64_t first = item % strips * strip, count = std::min(strip, windows - first);
    const int64_t group = item / strips % p.group, n = item / strips / p.group;
    const float* image = input + (n * p.c_image + group * p.c_image_per_group()) * pixels;
    float* const columns = scratch + thread * p.depth() * strip;
    for (int64_t ci = 0; ci < p.c_image_per_group(); ++ci)
      for (int64_t k = 0; k < taps; ++k)
        gather_pixels(p.axes, image + ci * pixels, k, first, count,
                      columns + (ci * taps + k) * count);
    float* out = output + (n * p.c_windows + group * channels) * windows + first;
    gemm({channels, count, p.depth(), weights + group * channels * p.depth(), p.depth(), columns,
          count, false, out, windows});
    for (int64_t co = 0; bias && co < channels; ++co)
      for (int64_t i = 0; i < count; ++i) out[co * windows + i] += bias[group * channels + co];
  });
}

void run_reference(const ConvolutionNdProblem& p, const float* input, const float* weights,
                   const float* bias, float* output, float*) {
  const int64_t windows = p.windows(), pixels = p.image_pixels(), taps = p.kernel_elements();
  for (int64_t n = 0; n < p.n; ++n)
    for (int64_t co = 0; co < p.c_windows; ++co)
      for (int64_t i = 0; i < windows; ++i) {
        const int64_t first_channel = co / p.c_windows_per_group() * p.c_image_per_group();
        double sum = 0;
        for (int64_t ci = 0; ci < p.c_image_per_group(); ++ci)
          for (int64_t k = 0; k < taps; ++k) {
            const int64_t pixel = pixel_under(p.axes, p.axes.size(), i, k);
            if (pixel < 0) continue;
            const double value = input[(n * p.c_image + first_channel + ci) * pixels + pixel];
            sum += value * weights[(co * p.c_image_per_group() + ci) * taps + k];
          }
        output[(n * p.c_windows + co) * windows + i] =
            static_cast<float>(sum + (bias ? bias[co] : 0.0F));
      }
}

int64_t no_scratch(const ConvolutionNdProblem&) {
  return 0;
}

}  // namespace

const ConvolutionNdKernel kConvolutionNdGemm = {"im2col-nd-gemm", scratch_floats, run};
const ConvolutionNdKernel kConvolutionNdReference = {"reference", no_scratch, run_reference};

}  // namespace revisit::engine
