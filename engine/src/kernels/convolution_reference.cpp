#include "kernels/convolution.h"

namespace revisit::engine {
namespace {

void run(const ConvolutionProblem& p, const float* input, const float* weights, const float* bias,
         float* output, float*) {
  for (int64_t n = 0; n < p.n; ++n)
    for (int64_t co = 0; co < p.c_out; ++co)
      for (int64_t y = 0; y < p.out_h; ++y)
        for (int64_t x = 0; x < p.out_w; ++x) {
          const int64_t first_channel = co / p.c_out_per_group() * p.c_in_per_group();
          double sum = 0;
          for (int64_t ci = 0; ci < p.c_in_per_group(); ++ci)
            for (int64_t ky = 0; ky < p.kernel_h; ++ky)
              for (int64_t kx = 0; kx < p.kernel_w; ++kx) {
                const int64_t iy = y * p.stride_h - p.pad_h + ky * p.dilation_h;
                const int64_t ix = x * p.stride_w - p.pad_w + kx * p.dilation_w;
                if (iy < 0 || iy >= p.h || ix < 0 || ix >= p.w) continue;
                const double value =
                    input[((n * p.c_in + first_channel + ci) * p.h + iy) * p.w + ix];
                sum +=
                    value *
                    weights[((co * p.c_in_per_group() + ci) * p.kernel_h + ky) * p.kernel_w + kx];
              }
          output[((n * p.c_out + co) * p.out_h + y) * p.out_w + x] =
              static_cast<float>(sum + (bias ? bias[co] : 0.0F));
        }
}

}  // namespace

const ConvolutionKernel kConvolutionReference = {
    "reference", [](const ConvolutionProblem&) { return true; },
    [](const ConvolutionProblem&) { return int64_t{0}; }, run};

}  // namespace revisit::engine
