#include "kernels/inner_product.h"

#include <algorithm>

#include "kernels/gemm.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

bool always(const InnerProductProblem&) {
  return true;
}

void run_gemm(const InnerProductProblem& p, const float* input, const float* weights,
              const float* bias, float* output) {
  constexpr int64_t kOutputs = 256;  // per work item, independent of the number of threads
  parallel_for((p.n + kOutputs - 1) / kOutputs, p.threads, [&](int64_t item, int) {
    const int64_t first = item * kOutputs, count = std::min(kOutputs, p.n - first);
    gemm({p.m, count, p.k, input, p.k, p.transposed ? weights + first : weights + first * p.k,
          p.transposed ? p.n : p.k, !p.transposed, output + first, p.n});
    for (int64_t m = 0; bias && m < p.m; ++m)
      for (int64_t i = first; i < first + count; ++i) output[m * p.n + i] += bias[i];
  });
}

void run_reference(const InnerProductProblem& p, const float* input, const float* weights,
                   const float* bias, float* output) {
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

const InnerProductKernel kInnerProductGemm = {"gemm", always, run_gemm, true};
const InnerProductKernel kInnerProductReference = {"reference", always, run_reference};

std::span<const InnerProductKernel> inner_product_kernels() {
  static const InnerProductKernel kList[] = {kInnerProductGemv, kInnerProductGemm,
                                             kInnerProductReference};
  return kList;
}

const InnerProductKernel& choose_inner_product(const InnerProductProblem& problem) {
  for (const InnerProductKernel& kernel : inner_product_kernels())
    if (kernel.supports(problem)) return kernel;
  return kInnerProductReference;
}

void inner_product(const InnerProductProblem& problem, const float* input, const float* weights,
                   const float* bias, float* output) {
  choose_inner_product(problem).run(problem, input, weights, bias, output);
}

}  // namespace revisit::engine
