#include "kernels/inner_product.h"

namespace revisit::engine {
namespace {

void run(const InnerProductProblem& p, const float* input, const float* weights, const float* bias,
         float* output) {
  for (int64_t m = 0; m < p.m; ++m)
    for (int64_t n = 0; n < p.n; ++n) {
      double sum = 0;
      for (int64_t k = 0; k < p.k; ++k)
        sum += static_cast<double>(input[m * p.k + k]) *
               weights[p.transposed ? k * p.n + n : n * p.k + k];
      output[m * p.n + n] = static_cast<float>(sum + (bias ? bias[n] : 0.0F));
    }
}

}  // namespace

const InnerProductKernel kInnerProductReference = {
    "reference", [](const InnerProductProblem&) { return true; }, run};

}  // namespace revisit::engine
