#pragma once

#include <cstdint>
#include <span>

#include "bfloat16.h"

namespace revisit::engine {

/// output[m][n] = input[m][k] * weights + bias[n]. Weights are [n][k], or [k][n] if `transposed`;
/// `bias` may be null.
struct InnerProductProblem {
  int64_t m = 1, n = 1, k = 1;
  bool transposed = false;
  int threads = 1;
};

struct InnerProductKernel {
  const char* name;
  bool (*supports)(const InnerProductProblem&);
  void (*run)(const InnerProductProblem&, const float* input, const float* weights,
              const float* bias, float* output);
  bool uses_blas = false;
};

/// Kernels in order of preference; the last is the reference and supports everything.
std::span<const InnerProductKernel> inner_product_kernels();

const InnerProductKernel& choose_inner_product(const InnerProductProblem& problem);
void inner_product(const InnerProductProblem& problem, const float* input, const float* weights,
                   const float* bias, float* output);

extern const InnerProductKernel kInnerProductGemv;  // for few inputs: reads the weights once
/// Like kInnerProductGemv, with bfloat16 weights; sums are in float32.
void inner_product_bf16(const InnerProductProblem& problem, const float* input,
                        const BFloat16* weights, const float* bias, float* output);

extern const InnerProductKernel kInnerProductGemm;
extern const InnerProductKernel kInnerProductReference;  // direct, in double precision

}  // namespace revisit::engine
