#include <algorithm>

#include "kernels/nchw.h"
#include "layout.h"
#include "revisit/engine/parallel_for.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/inner_product.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Wide = hn::ScalableTag<float>;

/// Outputs per loop, which share loads of the input and hide the latency of a multiply-add.
constexpr int kOutputs = 4;

HWY_INLINE hn::Vec<Wide> load(const float* from) {
  return hn::LoadU(Wide(), from);
}

HWY_INLINE hn::Vec<Wide> load(const BFloat16* from) {
  const hn::Rebind<uint32_t, Wide> bits;
  const auto half = hn::LoadU(hn::Rebind<uint16_t, Wide>(), &from->bits);
  return hn::BitCast(Wide(), hn::ShiftLeft<16>(hn::PromoteTo(bits, half)));
}

HWY_INLINE float to_float(float x) {
  return x;
}
using engine::to_float;

/// Computes `kCount` outputs of one input; row i of the weights is at `weights + i * k`.
template <int kCount, class Weight>
HWY_INLINE void dot_products(int64_t k, const float* input, const Weight* weights,
                             const float* bias, float* output) {
  const Wide d;
  const auto lanes = static_cast<int64_t>(hn::Lanes(d));
  hn::Vec<Wide> even[kCount], odd[kCount];
#pragma GCC unroll 4
  for (int i = 0; i < kCount; ++i) even[i] = odd[i] = hn::Zero(d);
  int64_t j = 0;
  for (; j + 2 * lanes <= k; j += 2 * lanes) {
    const auto x0 = hn::LoadU(d, input + j), x1 = hn::LoadU(d, input + j + lanes);
#pragma GCC unroll 4
    for (int i = 0; i < kCount; ++i) {
      even[i] = hn::MulAdd(x0, load(weights + i * k + j), even[i]);
      odd[i] = hn::MulAdd(x1, load(weights + i * k + j + lanes), odd[i]);
    }
  }
  const hn::CappedTag<float, 1> one;
#pragma GCC unroll 4
  for (int i = 0; i < kCount; ++i) {
    auto sum = hn::Set(one, hn::GetLane(hn::SumOfLanes(d, hn::Add(even[i], odd[i]))));
    // Vectors of one lane, so that the compiler rounds products of both types equally.
    for (int64_t rest = j; rest < k; ++rest)
      sum =
          hn::MulAdd(hn::Set(one, input[rest]), hn::Set(one, to_float(weights[i * k + rest])), sum);
    output[i] = bias ? hn::GetLane(sum) + bias[i] : hn::GetLane(sum);
  }
}

template <class Weight>
void multiply(const InnerProductProblem& p, const float* input, const Weight* weights,
              const float* bias, float* output) {
  constexpr int64_t kFloats = 65536;  // weights per work item
  const int64_t outputs = std::max<int64_t>(kFloats / p.k / kOutputs, 1) * kOutputs;
  parallel_ranges(p.n, outputs, p.threads, [&](int64_t begin, int64_t end) HWY_ATTR {
    for (int64_t i = begin; i < end;) {
      const bool whole = i + kOutputs <= end;
      for (int64_t m = 0; m < p.m; ++m)
        (whole ? dot_products<kOutputs, Weight>
               : dot_products<1, Weight>)(p.k, input + m * p.k, weights + i * p.k,
                                          bias ? bias + i : nullptr, output + m * p.n + i);
      i += whole ? kOutputs : 1;
    }
  });
}

}  // namespace

void gemv(const InnerProductProblem& p, const float* input, const float* weights, const float* bias,
          float* output) {
  multiply(p, input, weights, bias, output);
}

void gemv_bf16(const InnerProductProblem& p, const float* input, const BFloat16* weights,
               const float* bias, float* output) {
  multiply(p, input, weights, bias, output);
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

HWY_EXPORT(gemv);
HWY_EXPORT(gemv_bf16);

namespace {

void run(const InnerProductProblem& p, const float* input, const float* weights, const float* bias,
         float* output) {
  HWY_DYNAMIC_DISPATCH(gemv)(p, input, weights, bias, output);
}

}  // namespace

const InnerProductKernel kInnerProductGemv = {"gemv", run};

void inner_product_bf16(const InnerProductProblem& p, const float* input, const BFloat16* weights,
                        const float* bias, float* output) {
  HWY_DYNAMIC_DISPATCH(gemv_bf16)(p, input, weights, bias, output);
}

namespace {

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

const InnerProductKernel kInnerProductGemm = {"gemm", run_gemm, true};
const InnerProductKernel kInnerProductReference = {"reference", run_reference};

const InnerProductKernel& choose_inner_product(const InnerProductProblem& problem) {
  return problem.has_few_inputs() ? kInnerProductGemv : kInnerProductGemm;
}

void inner_product(const InnerProductProblem& problem, const float* input, const float* weights,
                   const float* bias, float* output) {
  choose_inner_product(problem).run(problem, input, weights, bias, output);
}

}  // namespace revisit::engine
#endif
