#include "align/moments.h"

#include <algorithm>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "align/moments.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace revisit::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
// Eight lanes on every CPU, so that the order of additions and the sums are the same.
constexpr size_t kSumLanes = 8;
using Double = hn::CappedTag<double, kSumLanes>;
using Narrow = hn::Rebind<float, Double>;
using V = hn::Vec<Double>;
constexpr Double kDouble;
constexpr size_t kVectors = kSumLanes / hn::MaxLanes(kDouble);
static_assert(kVectors * hn::MaxLanes(kDouble) == kSumLanes);

struct Differences {
  V x, y, z;  // 0 where there is no return
  V one;      // 1 for a return
};

HWY_INLINE Differences differences(const float* points, const std::array<double, 3>& about) {
  const Narrow narrow;
  hn::Vec<Narrow> nx, ny, nz, unused;
  hn::LoadInterleaved4(narrow, points, nx, ny, nz, unused);
  const V x = hn::PromoteTo(kDouble, nx), y = hn::PromoteTo(kDouble, ny),
          z = hn::PromoteTo(kDouble, nz);
  // Squares of floats cannot overflow in double: finite and not 0 exactly for returns.
  const V square = hn::Add(hn::Add(hn::Mul(x, x), hn::Mul(y, y)), hn::Mul(z, z));
  const auto is_return =
      hn::And(hn::Gt(square, hn::Zero(kDouble)),
              hn::Lt(square, hn::Set(kDouble, std::numeric_limits<double>::infinity())));
  const auto difference = [&](V coordinate, double from) HWY_ATTR {
    return hn::IfThenElseZero(is_return, hn::Sub(coordinate, hn::Set(kDouble, from)));
  };
  return {difference(x, about[0]), difference(y, about[1]), difference(z, about[2]),
          hn::IfThenElseZero(is_return, hn::Set(kDouble, 1))};
}

/// Sums `kCount` values of every point, `terms(differences)` -> array of vectors.
template <size_t kCount, class Terms>
HWY_INLINE std::array<double, kCount> sums_of(const float* points, size_t n,
                                              const std::array<double, 3>& about, Terms terms) {
  V sums[kVectors][kCount];
  for (auto& vector : sums)
    for (V& sum : vector) sum = hn::Zero(kDouble);
  const auto add = [&](const float* eight) HWY_ATTR {
    for (size_t v = 0; v < kVectors; ++v) {
      V term[kCount];
      terms(differences(eight + v * 4 * hn::MaxLanes(kDouble), about), term);
      for (size_t i = 0; i < kCount; ++i) sums[v][i] = hn::Add(sums[v][i], term[i]);
    }
  };
  const size_t whole = n / kSumLanes * kSumLanes;
  for (size_t i = 0; i < whole; i += kSumLanes) add(points + 4 * i);
  float rest[4 * kSumLanes] = {};  // padding at the origin: no returns
  std::copy(points + 4 * whole, points + 4 * n, rest);
  add(rest);

  std::array<double, kCount> result;
  for (size_t i = 0; i < kCount; ++i) {
    double lanes[kSumLanes];
    for (size_t v = 0; v < kVectors; ++v)
      hn::StoreU(sums[v][i], kDouble, lanes + v * hn::MaxLanes(kDouble));
    result[i] = ((lanes[0] + lanes[4]) + (lanes[1] + lanes[5])) +
                ((lanes[2] + lanes[6]) + (lanes[3] + lanes[7]));
  }
  return result;
}

}  // namespace

std::array<double, 4> first_sums(const float* points, size_t n,
                                 const std::array<double, 3>& about) {
  return sums_of<4>(points, n, about, [](const Differences& d, V* terms) HWY_ATTR {
    terms[0] = d.one;
    terms[1] = d.x;
    terms[2] = d.y;
    terms[3] = d.z;
  });
}

std::array<double, 6> second_sums(const float* points, size_t n,
                                  const std::array<double, 3>& about) {
  return sums_of<6>(points, n, about, [](const Differences& d, V* terms) HWY_ATTR {
    terms[0] = hn::Mul(d.x, d.x);
    terms[1] = hn::Mul(d.x, d.y);
    terms[2] = hn::Mul(d.x, d.z);
    terms[3] = hn::Mul(d.y, d.y);
    terms[4] = hn::Mul(d.y, d.z);
    terms[5] = hn::Mul(d.z, d.z);
  });
}

}  // namespace revisit::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit {

HWY_EXPORT(first_sums);
HWY_EXPORT(second_sums);

std::array<double, 4> first_moments(const float* points, size_t n,
                                    const std::array<double, 3>& about) {
  return HWY_DYNAMIC_DISPATCH(first_sums)(points, n, about);
}

std::array<double, 6> second_moments(const float* points, size_t n,
                                     const std::array<double, 3>& about) {
  return HWY_DYNAMIC_DISPATCH(second_sums)(points, n, about);
}

}  // namespace revisit
#endif  // HWY_ONCE
