#include <algorithm>
#include <cmath>

#include "revisit/base/error.h"
#include "revisit/recognition/range_image.h"

namespace revisit {
namespace {

void check(bool ok, const char* what, const std::string& found) {
  if (!ok) throw UsageError("image geometry: ", what, ", found ", found);
}

/// Returns the odd number nearest to degrees / pixel (the larger one on a tie), at most `most`.
int odd_pixels(double degrees, double pixel, int most) {
  constexpr double kRounding = 1e-9;  // tolerance for quotients that are integers
  const int largest = most - (most % 2 ? 0 : 1);
  return std::min(2 * static_cast<int>(degrees / pixel / 2 + kRounding) + 1, largest);
}

}  // namespace

ClosingRectangle closing_rectangle(const ImageGeometry& g) {
  return {
      odd_pixels(g.closing_width, 360.0 / g.width, g.width),
      odd_pixels(g.closing_height, (g.elevation_top - g.elevation_bottom) / g.height, g.height)};
}

void check_geometry(const ImageGeometry& g) {
  constexpr int kLargest = 1 << 16;        // [pixels]
  constexpr int64_t kMaxPixels = 1 << 26;  // 256 MB
  check(g.width >= 1 && g.width <= kLargest, "expected a width from 1 to 65536", str(g.width));
  check(g.height >= 1 && g.height <= kLargest, "expected a height from 1 to 65536", str(g.height));
  check(int64_t{g.width} * g.height <= kMaxPixels, "expected at most 67108864 pixels",
        str(g.width, " x ", g.height));
  check(g.elevation_top <= 90 && g.elevation_bottom >= -90 && g.elevation_top > g.elevation_bottom,
        "expected 90 >= top > bottom >= -90 degrees of elevation",
        str("top ", g.elevation_top, ", bottom ", g.elevation_bottom));
  check(g.max_range > 0 && std::isfinite(g.max_range), "expected a maximum range above 0 m",
        str(g.max_range));
  const auto is_angle = [](double side) { return side >= 0 && side <= 360; };
  check(is_angle(g.closing_width) && is_angle(g.closing_height),
        "expected a closing rectangle of 0 to 360 degrees",
        str(g.closing_width, " x ", g.closing_height));
}

}  // namespace revisit
