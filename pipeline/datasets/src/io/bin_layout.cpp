#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <optional>

#include "io/point_files.h"

namespace revisit {
namespace {

constexpr size_t kMinPoints = 100, kPointsLookedAt = 2000;

struct Moments {
  double n = 0, sum = 0, squares = 0;
  void add(double x) {
    ++n;
    sum += x;
    squares += x * x;
  }
  double variance() const { return squares / n - sum / n * (sum / n); }
};

/// Returns the mean variance of magnitudes within columns, relative to that of all values. Returns
/// infinity unless nearly all points are some meters away.
double variance_left(std::span<const std::byte> content, const BinLayout& layout) {
  constexpr double kNearest = 1e-3, kMaxRange = 1000;  // [m]
  constexpr double kPlausible = 0.9;
  const size_t points = content.size() / layout.bytes();
  // Coprime to 3, 4, 5 and 6 values per point: otherwise sampled points could begin with an x under
  // another layout, too.
  size_t step = std::max<size_t>(1, points / kPointsLookedAt);
  while (std::gcd(step, size_t{60}) != 1) ++step;
  std::array<Moments, 6> columns;
  Moments all;
  double looked_at = 0, plausible = 0;
  for (size_t i = 0; i < points; i += step, ++looked_at) {
    double largest = 0;
    for (size_t c = 0; c < layout.numbers; ++c) {
      const double magnitude = std::abs(number_at(content, layout, i, c));
      if (c < 3) largest = std::max(largest, magnitude);
      if (!(magnitude < 1e30)) continue;
      columns.at(c).add(std::log2(std::max(magnitude, kNearest)));
      all.add(std::log2(std::max(magnitude, kNearest)));
    }
    plausible += largest == 0 || (largest > kNearest && largest < kMaxRange) ? 1 : 0;
  }
  if (plausible < kPlausible * looked_at || !(all.variance() > 0))
    return std::numeric_limits<double>::infinity();
  double within = 0;
  for (size_t c = 0; c < layout.numbers; ++c)
    within += columns.at(c).variance() / static_cast<double>(layout.numbers);
  return within / all.variance();
}

}  // namespace

double number_at(std::span<const std::byte> content, const BinLayout& layout, size_t point,
                 size_t column) {
  const std::byte* const at = &content[point * layout.bytes()];
  if (layout.doubles) {
    double value = 0;
    std::memcpy(&value, at + 8 * column, 8);
    return value;
  }
  float value = 0;
  std::memcpy(&value, at + 4 * column, 4);
  return value;
}

BinLayout find_bin_layout(std::span<const std::byte> content) {
  constexpr double kTells = 0.85;   // the correct layout of real scans has at most 0.7
  constexpr double kClearly = 0.8;  // factor to prefer a layout to KITTI's
  constexpr double kTwice = 0.9;    // factor to prefer a layout to one of half as many values
  // Two float32 may look like one float64, so float64 is tried only if float32 are no coordinates.
  for (const bool doubles : {false, true}) {
    std::optional<BinLayout> best;
    double least = kTells;
    for (const size_t numbers : {4, 3, 5, 6}) {
      const BinLayout layout{numbers, doubles};
      if (content.size() % layout.bytes() != 0 || content.size() / layout.bytes() < kMinPoints)
        continue;
      const double left = variance_left(content, layout);
      const double margin = !best                          ? 1
                            : 2 * best->numbers == numbers ? kTwice
                            : best->numbers == 4           ? kClearly
                                                           : 1;
      if (left >= margin * least) continue;
      best = layout;
      least = left;
    }
    if (best) return *best;
  }
  return {};
}

}  // namespace revisit
