#include "ring/codes.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "ring/code_products.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace revisit::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// One lane per place.
using Whole = hn::CappedTag<int16_t, kCodesPerGroup>;
using Byte = hn::Rebind<uint8_t, Whole>;
using Float = hn::CappedTag<float, kCodesPerGroup>;
using Long = hn::Rebind<int32_t, Float>;
constexpr Whole kWhole;
constexpr Byte kByte;
constexpr Float kFloat;
constexpr Long kLong;

/// sum of a conj(b) per frequency, for kCodesPerGroup places: real parts, then imaginary parts.
template <class T>
struct Products {
  alignas(64) T real[kRingFrequencies][kCodesPerGroup];
  alignas(64) T imaginary[kRingFrequencies][kCodesPerGroup];
};

/// One vector of places, from lane `first` on.
HWY_INLINE void multiply(const CodeQuery& query, const uint8_t* codes, size_t first,
                         Products<int16_t>& to) {
  const int16_t* a = query.parts.data();
  const uint8_t* b = codes + first;
  for (size_t f = 0; f < kRingFrequencies; ++f) {
    auto real = hn::Zero(kWhole), imaginary = hn::Zero(kWhole);
    for (int i = 0; i < query.counts[f]; ++i) {
      const auto coefficient = hn::PromoteTo(kWhole, hn::Load(kByte, b));
      const auto br = hn::ShiftRight<12>(hn::ShiftLeft<12>(coefficient)),
                 bi = hn::ShiftRight<12>(hn::ShiftLeft<8>(coefficient));
      const auto ar = hn::Set(kWhole, a[0]), ai = hn::Set(kWhole, a[1]);
      real = hn::Add(real, hn::Add(hn::Mul(ar, br), hn::Mul(ai, bi)));
      imaginary = hn::Add(imaginary, hn::Sub(hn::Mul(ai, br), hn::Mul(ar, bi)));
      a += 2;
      b += kCodesPerGroup;
    }
    hn::Store(real, kWhole, to.real[f] + first);
    hn::Store(imaginary, kWhole, to.imaginary[f] + first);
  }
}

HWY_INLINE void to_floats(const int16_t* whole, float* floats) {
  for (size_t lane = 0; lane < kCodesPerGroup; lane += hn::Lanes(kFloat)) {
    const auto coefficients = hn::Load(hn::Rebind<int16_t, Float>(), whole + lane);
    hn::Store(hn::ConvertTo(kFloat, hn::PromoteTo(kLong, coefficients)), kFloat, floats + lane);
  }
}

/// Maximum over all yaw angles, for one vector of places from lane `first` on.
HWY_INLINE hn::Vec<Float> largest_at(const Products<float>& of, const CodeWaves& waves,
                                     size_t first) {
  auto largest = hn::Zero(kFloat);
  for (size_t t = 0; t < CodeWaves::kSize; ++t) {
    auto even_cosine = hn::Load(kFloat, of.real[0] + first), odd_cosine = hn::Zero(kFloat),
         even_sine = hn::Zero(kFloat), odd_sine = hn::Zero(kFloat);
    const auto add = [&](size_t f, auto& cosine, auto& sine) HWY_ATTR {
      cosine = hn::MulAdd(hn::Set(kFloat, waves.cosines[f][t]),
                          hn::Load(kFloat, of.real[f] + first), cosine);
      sine = hn::MulAdd(hn::Set(kFloat, waves.sines[f][t]),
                        hn::Load(kFloat, of.imaginary[f] + first), sine);
    };
    for (size_t f = 1; f < kRingFrequencies; f += 2) {
      add(f, odd_cosine, odd_sine);
      add(f + 1, even_cosine, even_sine);
    }
    const auto here =
                   hn::Add(hn::Add(even_cosine, odd_cosine), hn::Abs(hn::Add(even_sine, odd_sine))),
               opposite =
                   hn::Add(hn::Sub(even_cosine, odd_cosine), hn::Abs(hn::Sub(even_sine, odd_sine)));
    const auto larger = hn::Max(here, opposite);
    largest = t == 0 ? larger : hn::Max(largest, larger);
  }
  return largest;
}

void max_code_products_simd(const CodeQuery& query, const uint8_t* codes,
                            std::span<const float> scales, std::span<float> largest,
                            const CodeWaves& waves) {
  Products<int16_t> whole;
  Products<float> products;
  for (size_t group = 0; group < scales.size(); group += kCodesPerGroup) {
    for (size_t lane = 0; lane < kCodesPerGroup; lane += hn::Lanes(kWhole))
      multiply(query, codes, lane, whole);
    for (size_t f = 0; f < kRingFrequencies; ++f) {
      to_floats(whole.real[f], products.real[f]);
      to_floats(whole.imaginary[f], products.imaginary[f]);
    }
    for (size_t lane = 0; lane < kCodesPerGroup; lane += hn::Lanes(kFloat)) {
      const auto scaled = hn::Mul(largest_at(products, waves, lane),
                                  hn::LoadU(kFloat, scales.data() + group + lane));
      hn::StoreU(scaled, kFloat, largest.data() + group + lane);
    }
    codes += query.parts.size() / 2 * kCodesPerGroup;
  }
}

}  // namespace
}  // namespace revisit::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit {

static_assert(kRingFrequencies % 2 == 1, "frequency 0, and pairs of an odd and an even one");

HWY_EXPORT(max_code_products_simd);

void max_code_products(const CodeQuery& query, const uint8_t* codes, std::span<const float> scales,
                       std::span<float> largest) {
  static const CodeWaves waves;
  HWY_DYNAMIC_DISPATCH(max_code_products_simd)(query, codes, scales, largest, waves);
}

}  // namespace revisit
#endif  // HWY_ONCE
