#include "revisit/recognition/keys.h"

#include <algorithm>
#include <memory>
#include <numeric>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "retrieve/keys.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace revisit::pipeline::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, 16>;
constexpr D kD;

float product(const float* a, const float* b, size_t n) {
  const size_t lanes = hn::Lanes(kD);
  auto even = hn::Zero(kD), odd = hn::Zero(kD);
  size_t i = 0;
  for (; i + 2 * lanes <= n; i += 2 * lanes) {
    even = hn::MulAdd(hn::LoadU(kD, a + i), hn::LoadU(kD, b + i), even);
    odd = hn::MulAdd(hn::LoadU(kD, a + i + lanes), hn::LoadU(kD, b + i + lanes), odd);
  }
  float sum = hn::GetLane(hn::SumOfLanes(kD, hn::Add(even, odd)));
  for (; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

void products_simd(std::span<const float> key, const FloatMatrix& keys,
                   std::span<const int64_t> candidates, float* products) {
  for (size_t i = 0; i < candidates.size(); ++i)
    products[i] = product(key.data(), keys.row(candidates[i]).data(), key.size());
}

void products_of_rows_simd(std::span<const float> key, const FloatMatrix& keys, int64_t first,
                           std::span<float> products) {
  for (size_t i = 0; i < products.size(); ++i)
    products[i] = product(key.data(), keys.row(first + static_cast<int64_t>(i)).data(), key.size());
}

}  // namespace
}  // namespace revisit::pipeline::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::pipeline {

HWY_EXPORT(products_simd);
HWY_EXPORT(products_of_rows_simd);

FloatMatrix keys_of(const FloatMatrix& descriptors, const KeyOf& key_of) {
  FloatMatrix keys(descriptors.n, key_of.numbers);
  for (int64_t i = 0; i < keys.n; ++i) key_of.make(descriptors.row(i), keys.row(i));
  return keys;
}

void products_of_rows(std::span<const float> key, const FloatMatrix& keys, int64_t first,
                      std::span<float> products) {
  HWY_DYNAMIC_DISPATCH(products_of_rows_simd)(key, keys, first, products);
}

std::vector<size_t> positions_of_largest(std::span<const float> numbers, int64_t count) {
  std::vector<size_t> positions(numbers.size());
  std::iota(positions.begin(), positions.end(), size_t{0});
  if (count >= static_cast<int64_t>(positions.size())) return positions;
  std::nth_element(positions.begin(), positions.begin() + count, positions.end(),
                   [&](size_t a, size_t b) {
                     return numbers[a] != numbers[b] ? numbers[a] > numbers[b] : a < b;
                   });
  positions.resize(static_cast<size_t>(count));
  std::ranges::sort(positions);
  return positions;
}

std::vector<size_t> largest_products(std::span<const float> key, const FloatMatrix& keys,
                                     std::span<const int64_t> candidates, int64_t count) {
  std::vector<float> products(candidates.size());
  HWY_DYNAMIC_DISPATCH(products_simd)(key, keys, candidates, products.data());
  return positions_of_largest(products, count);
}

Similarity similarity_by_keys(Similarity similarity, const KeyOf& key_of, FloatMatrix keys,
                              int64_t count) {
  return [similarity = std::move(similarity), key_of, count,
          keys = std::make_shared<const FloatMatrix>(std::move(keys))](
             std::span<const float> query, const FloatMatrix& stored,
             std::span<const int64_t> candidates, std::span<double> similarities) {
    std::vector<float> key(static_cast<size_t>(key_of.numbers));
    key_of.make(query, key);
    const std::vector<size_t> chosen = largest_products(key, *keys, candidates, count);
    std::vector<int64_t> rows;
    rows.reserve(chosen.size());
    for (const size_t i : chosen) rows.push_back(candidates[i]);
    std::vector<double> of_chosen(chosen.size());
    similarity(query, stored, rows, of_chosen);
    std::ranges::fill(similarities, -1);
    for (size_t i = 0; i < chosen.size(); ++i) similarities[chosen[i]] = of_chosen[i];
  };
}

}  // namespace revisit::pipeline
#endif  // HWY_ONCE
