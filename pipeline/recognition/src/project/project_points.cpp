#include <algorithm>
#include <iterator>
#include <limits>
#include <numbers>

#include "project/panorama.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "project/project_points.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace revisit::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Wide = hn::ScalableTag<double>;
using D = hn::Rebind<float, Wide>;  // as many lanes as Wide
using F = hn::Vec<D>;
using Mask = hn::Mask<D>;
constexpr Wide kWide;
constexpr D kD;
constexpr size_t kMaxLanes = hn::MaxLanes(kD);

/// Error bound of a float row or column [half turns]: 2e-7 of angle_of(), plus the addition's.
constexpr double kAngleError = 3e-7;

HWY_INLINE F all(double value) {
  return hn::Set(kD, static_cast<float>(value));
}

/// x P(x^2) on 0..1, minimax: absolute error 3.8e-8 exact, below 1.5e-7 in float.
HWY_INLINE F arc_tangent(F x) {
  constexpr double kCoefficients[] = {-0.004054575625, 0.02186298771, -0.05591236872, 0.096422003,
                                      -0.1390863066,   0.1994656586,  -0.333298608,   0.9999993356};
  const F square = hn::Mul(x, x);
  F sum = all(kCoefficients[0]);
  for (size_t i = 1; i < std::size(kCoefficients); ++i)
    sum = hn::MulAdd(sum, square, all(kCoefficients[i]));
  return hn::Mul(sum, x);
}

/// Angle of (x, y >= 0), CCW from x, in units of 180 deg / `half_turn`; NaN for (0, 0).
HWY_INLINE F angle_of(F y, F x, double half_turn) {
  const F across = hn::Abs(x);
  const F octant = hn::Mul(arc_tangent(hn::Div(hn::Min(y, across), hn::Max(y, across))),
                           all(half_turn / std::numbers::pi));
  const F quadrant = hn::IfThenElse(hn::Gt(y, across), hn::Sub(all(half_turn / 2), octant), octant);
  return hn::IfThenElse(hn::Lt(x, hn::Zero(kD)), hn::Sub(all(half_turn), quadrant), quadrant);
}

/// True where all values within `error` of `values` have the same integer part. False for NaN.
HWY_INLINE Mask decided(F values, double error) {
  return hn::Gt(hn::Abs(hn::Sub(values, hn::Round(values))), all(error));
}

/// Computed in double, because squares of floats are exact and cannot overflow.
struct Distances {
  F ground_square;  // x^2 + y^2
  F value;          // value of the pixel; 0: no return
};
HWY_INLINE Distances distances_of(F x, F y, F z, const Panorama& p) {
  const auto square = [](F v) HWY_ATTR {
    const auto wide = hn::PromoteTo(kWide, v);
    return hn::Mul(wide, wide);
  };
  const auto ground = hn::Add(square(x), square(y));
  const auto space = hn::Add(ground, square(z));
  const auto is_return =
      hn::And(hn::Gt(space, hn::Zero(kWide)),
              hn::Lt(space, hn::Set(kWide, std::numeric_limits<double>::infinity())));
  const auto value = hn::Mul(hn::Min(hn::Sqrt(space), hn::Set(kWide, p.max_range)),
                             hn::Set(kWide, p.value_per_meter));
  return {hn::DemoteTo(kD, ground), hn::DemoteTo(kD, hn::IfThenElseZero(is_return, value))};
}

struct Hits {
  HWY_ALIGN float x[kMaxLanes], y[kMaxLanes], z[kMaxLanes];
  HWY_ALIGN int32_t pixel[kMaxLanes];
  HWY_ALIGN float value[kMaxLanes];        // 0: no hit
  HWY_ALIGN int32_t undecided[kMaxLanes];  // not 0: too near a pixel border for float arithmetic
  int64_t returns = 0, outside = 0;        // sum over all vectors so far
};

/// Returns true if any point is undecided.
HWY_INLINE bool hit(const float* points, const float* R, const Panorama& p, Hits& hits) {
  const hn::RebindToSigned<D> integers;
  F px, py, pz, unused;
  hn::LoadInterleaved4(kD, points, px, py, pz, unused);
  // Arithmetic of rotated(), without fused multiply-add.
  const auto turned = [&](const float* row) HWY_ATTR {
    return hn::Add(hn::Add(hn::Mul(hn::Set(kD, row[0]), px), hn::Mul(hn::Set(kD, row[1]), py)),
                   hn::Mul(hn::Set(kD, row[2]), pz));
  };
  const F x = turned(R), y = turned(R + 3), z = turned(R + 6);

  const auto [ground_square, value] = distances_of(x, y, z, p);

  // Outside these limits a float loses precision. (NaN is outside, too.)
  const Mask normal = hn::And(hn::Gt(ground_square, all(1e-30)), hn::Lt(ground_square, all(1e30)));
  const F elevation = angle_of(hn::Abs(z), hn::Sqrt(ground_square), p.half_turn_rows);
  const F row = hn::Sub(all(p.rows_above_horizon), hn::CopySign(elevation, z));
  const Mask row_decided = hn::And(normal, decided(row, kAngleError * p.half_turn_rows));
  const Mask outside =
      hn::AndNot(hn::And(hn::Gt(row, hn::Zero(kD)), hn::Lt(row, all(p.height))), row_decided);

  const double half_width = 0.5 * p.width;
  const int left_columns = p.width / 2;
  const Mask right_half =
      hn::Or(hn::Lt(y, hn::Zero(kD)), hn::And(hn::Eq(y, hn::Zero(kD)), hn::Gt(x, hn::Zero(kD))));
  const F clockwise = angle_of(hn::Abs(y), hn::IfThenElse(right_half, x, hn::Neg(x)), half_width);
  const F column =
      hn::Add(clockwise, hn::IfThenElseZero(right_half, all(half_width - left_columns)));
  const Mask column_decided = decided(column, kAngleError * half_width);

  const auto whole_column = hn::Add(
      hn::ConvertTo(integers, column),
      hn::IfThenElseZero(hn::RebindMask(integers, right_half), hn::Set(integers, left_columns)));
  const auto pixel =
      hn::Add(hn::Mul(hn::ConvertTo(integers, row), hn::Set(integers, p.width)), whole_column);
  const Mask is_return = hn::Gt(value, hn::Zero(kD));
  const Mask wanted = hn::AndNot(outside, is_return);
  const Mask undecided = hn::AndNot(hn::And(row_decided, column_decided), wanted);

  hits.returns += static_cast<int64_t>(hn::CountTrue(kD, is_return));
  hits.outside += static_cast<int64_t>(hn::CountTrue(kD, hn::And(outside, is_return)));
  hn::Store(pixel, integers, hits.pixel);
  hn::Store(hn::IfThenElseZero(wanted, value), kD, hits.value);
  if (hn::AllFalse(kD, undecided)) return false;
  hn::Store(hn::VecFromMask(integers, hn::RebindMask(integers, undecided)), integers,
            hits.undecided);
  hn::Store(x, kD, hits.x);
  hn::Store(y, kD, hits.y);
  hn::Store(z, kD, hits.z);
  return true;
}

HWY_NOINLINE void decide(const Panorama& p, Hits& hits) {
  for (size_t i = 0; i < hn::Lanes(kD); ++i) {
    if (!hits.undecided[i]) continue;
    const int64_t pixel = pixel_of(p, hits.x[i], hits.y[i], hits.z[i]);
    if (pixel < 0) {
      hits.value[i] = 0;
      ++hits.outside;
    }
    hits.pixel[i] = static_cast<int32_t>(pixel);
  }
}

void project_vector(const float* points, const float* R, const Panorama& p, float* pixels,
                    Hits& hits) {
  if (hit(points, R, p, hits)) decide(p, hits);
  for (size_t i = 0; i < hn::Lanes(kD); ++i) {
    if (hits.value[i] == 0) continue;
    float& pixel = pixels[hits.pixel[i]];
    if (pixel == 0 || hits.value[i] < pixel) pixel = hits.value[i];
  }
}

}  // namespace

void project_points_simd(const float* points, size_t n, const float* R, const Panorama& p,
                         RangeImage& image) {
  float* const pixels = image.pixels.data();
  Hits hits;
  const size_t lanes = hn::Lanes(kD), whole = n / lanes * lanes;
  for (size_t i = 0; i < whole; i += lanes) project_vector(points + 4 * i, R, p, pixels, hits);
  float rest[4 * kMaxLanes] = {};  // padding at the origin: no returns
  std::copy(points + 4 * whole, points + 4 * n, rest);
  project_vector(rest, R, p, pixels, hits);
  image.returns = hits.returns;
  image.outside = hits.outside;
}

}  // namespace revisit::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit {

HWY_EXPORT(project_points_simd);

void project_points(const float* points, size_t n, const float* R, const Panorama& panorama,
                    RangeImage& image) {
  HWY_DYNAMIC_DISPATCH(project_points_simd)(points, n, R, panorama, image);
}

}  // namespace revisit
#endif  // HWY_ONCE
