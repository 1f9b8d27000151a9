#pragma once

#include <cstdint>

namespace revisit::engine {

/// output[m][n] = input[m][k] * weights + bias[n]; weights are [n][k], or [k][n] when `transposed`.
/// `bias` may be null.
struct InnerProductProblem {
  int64_t m = 1, n = 1, k = 1;
  bool transposed = false;
  int threads = 1;
};

void inner_product(const InnerProductProblem& problem, const float* input, const float* weights,
                   const float* bias, float* output);
void inner_product_reference(const InnerProductProblem& problem, const float* input,
                             const float* weights, const float* bias, float* output);

}  // namespace revisit::engine
