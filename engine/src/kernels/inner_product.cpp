#include "kernels/inner_product.h"

namespace revisit::engine {

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
