#include <cstddef>

#include "retrieve/shortlist.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "retrieve/products.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace revisit::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Sixteen = hn::CappedTag<float, 16>;
constexpr Sixteen kSixteen;

float product(const float* a, const float* b, size_t n) {
  const size_t lanes = hn::Lanes(kSixteen);
  auto even = hn::Zero(kSixteen), odd = hn::Zero(kSixteen);
  size_t i = 0;
  for (; i + 2 * lanes <= n; i += 2 * lanes) {
    even = hn::MulAdd(hn::LoadU(kSixteen, a + i), hn::LoadU(kSixteen, b + i), even);
    odd = hn::MulAdd(hn::LoadU(kSixteen, a + i + lanes), hn::LoadU(kSixteen, b + i + lanes), odd);
  }
  float sum = hn::GetLane(hn::SumOfLanes(kSixteen, hn::Add(even, odd)));
  for (; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

void products_simd(std::span<const float> key, const float* rows, std::span<float> products) {
  for (size_t i = 0; i < products.size(); ++i)
    products[i] = product(key.data(), rows + i * key.size(), key.size());
}

}  // namespace
}  // namespace revisit::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit {

HWY_EXPORT(products_simd);

void products_of_rows(std::span<const float> key, const float* rows, std::span<float> products) {
  HWY_DYNAMIC_DISPATCH(products_simd)(key, rows, products);
}

}  // namespace revisit
#endif  // HWY_ONCE
