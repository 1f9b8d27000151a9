#include <algorithm>

#include "kernels/inner_product.h"
#include "kernels/parallel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/inner_product_gemv.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Wide = hn::ScalableTag<float>;

/// Outputs computed together: each input value is loaded once for all, and there are sums enough to
/// hide the latency of a multiply-add.
constexpr int kOutputs = 4;

/// `kCount` outputs of one input: rows `weights + i * k`.
template <int kCount>
HWY_INLINE void dot_products(int64_t k, const float* input, const float* weights, const float* bias,
                             float* output) {
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
      even[i] = hn::MulAdd(x0, hn::LoadU(d, weights + i * k + j), even[i]);
      odd[i] = hn::MulAdd(x1, hn::LoadU(d, weights + i * k + j + lanes), odd[i]);
    }
  }
#pragma GCC unroll 4
  for (int i = 0; i < kCount; ++i) {
    float sum = hn::GetLane(hn::SumOfLanes(d, hn::Add(even[i], odd[i])));
    for (int64_t rest = j; rest < k; ++rest) sum += input[rest] * weights[i * k + rest];
    output[i] = bias ? sum + bias[i] : sum;
  }
}

}  // namespace

void gemv(const InnerProductProblem& p, const float* input, const float* weights, const float* bias,
          float* output) {
  constexpr int64_t kFloats = 65536;  // of the weights, per item of work
  const int64_t outputs = std::max<int64_t>(kFloats / p.k / kOutputs, 1) * kOutputs;
  parallel_ranges(p.n, outputs, p.threads, [&](int64_t begin, int64_t end) HWY_ATTR {
    for (int64_t i = begin; i < end;) {
      const bool whole = i + kOutputs <= end;
      for (int64_t m = 0; m < p.m; ++m)
        (whole ? dot_products<kOutputs> : dot_products<1>)(p.k, input + m * p.k, weights + i * p.k,
                                                           bias ? bias + i : nullptr,
                                                           output + m * p.n + i);
      i += whole ? kOutputs : 1;
    }
  });
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

HWY_EXPORT(gemv);

namespace {

bool supports(const InnerProductProblem& p) {
  constexpr int64_t kMaxInputs = 8;  // a matrix product is faster from about 12 on
  return !p.transposed && p.m <= kMaxInputs;
}

void run(const InnerProductProblem& p, const float* input, const float* weights, const float* bias,
         float* output) {
  HWY_DYNAMIC_DISPATCH(gemv)(p, input, weights, bias, output);
}

}  // namespace

const InnerProductKernel kInnerProductGemv = {"gemv", supports, run};

}  // namespace revisit::engine
#endif  // HWY_ONCE
