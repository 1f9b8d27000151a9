#include <algorithm>
#include <cmath>

#include "revisit/recognition/matrix.h"

namespace revisit {
namespace {

/// Eight partial sums, which the compiler vectorizes; a fixed order of additions gives equal bits.
double dot(std::span<const float> a, std::span<const float> b) {
  double sums[8] = {};
  size_t i = 0;
  for (; i + 8 <= a.size(); i += 8)
    for (size_t lane = 0; lane < 8; ++lane)
      sums[lane] += static_cast<double>(a[i + lane]) * static_cast<double>(b[i + lane]);
  double rest = 0;
  for (; i < a.size(); ++i) rest += static_cast<double>(a[i]) * static_cast<double>(b[i]);
  return ((sums[0] + sums[4]) + (sums[1] + sums[5])) + ((sums[2] + sums[6]) + (sums[3] + sums[7])) +
         rest;
}

}  // namespace

double length_of(std::span<const float> x) {
  return std::sqrt(dot(x, x));
}

double cosine(std::span<const float> a, double length_a, std::span<const float> b,
              double length_b) {
  if (length_a == 0 || length_b == 0) return 0;
  return std::clamp(dot(a, b) / length_a / length_b, -1.0, 1.0);
}

}  // namespace revisit
