#include <algorithm>

#include "kernels/gemm.h"
#include "kernels/inner_product.h"
#include "kernels/parallel.h"

namespace revisit::engine {
namespace {

void run(const InnerProductProblem& p, const float* input, const float* weights, const float* bias,
         float* output) {
  constexpr int64_t kOutputs = 256;  // per item of work, whatever the number of threads
  parallel_for((p.n + kOutputs - 1) / kOutputs, p.threads, [&](int64_t item, int) {
    const int64_t first = item * kOutputs, count = std::min(kOutputs, p.n - first);
    gemm({p.m, count, p.k, input, p.k, p.transposed ? weights + first : weights + first * p.k,
          p.transposed ? p.n : p.k, !p.transposed, output + first, p.n});
    for (int64_t m = 0; bias && m < p.m; ++m)
      for (int64_t i = first; i < first + count; ++i) output[m * p.n + i] += bias[i];
  });
}

}  // namespace

const InnerProductKernel kInnerProductGemm = {"gemm",
                                              [](const InnerProductProblem&) { return true; }, run};

}  // namespace revisit::engine
