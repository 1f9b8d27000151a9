#include "project/panorama.h"

#include <cmath>
#include <numbers>

namespace revisit {
namespace {

double half_turns(double radians) {
  return radians / std::numbers::pi;  // exact for a quarter and an eighth of a revolution
}

}  // namespace

Panorama::Panorama(const ImageGeometry& g)
    : width(g.width),
      height(g.height),
      half_turn_rows(180 * (g.height / (g.elevation_top - g.elevation_bottom))),
      rows_above_horizon(g.elevation_top * (g.height / (g.elevation_top - g.elevation_bottom))),
      max_range(g.max_range),
      value_per_meter(255 / g.max_range) {}

int64_t pixel_of(const Panorama& p, float x, float y, float z) {
  const double ground = std::sqrt(double{x} * double{x} + double{y} * double{y});
  const double elevation = half_turns(std::atan2(double{z}, ground));
  const double row = std::floor(p.rows_above_horizon - elevation * p.half_turn_rows);
  if (!(row >= 0 && row < p.height)) return -1;

  // Computed per half of the image, clockwise from backwards, so that a cloud rotated by exactly
  // 180 degrees (x and y negated) moves by half an (even) width without rounding.
  const bool right_half = y < 0 || (y == 0 && x > 0);
  const double clockwise = half_turns(std::atan2(std::abs(double{y}), double{right_half ? x : -x}));
  const double odd_half_column = p.width % 2 ? 0.5 : 0;  // half of an odd width is not an integer
  const double column_in_half =
      std::floor(clockwise * (0.5 * p.width) + (right_half ? odd_half_column : 0));
  auto column = static_cast<int64_t>(column_in_half) + (right_half ? p.width / 2 : 0);
  if (column >= p.width) column -= p.width;  // 180 degrees clockwise of forwards, rounded up
  return static_cast<int64_t>(row) * p.width + column;
}

}  // namespace revisit
