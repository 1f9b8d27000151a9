#pragma once

#include <algorithm>
#include <cmath>
#include <span>

namespace revisit::test {

/// max|a - b| / max|b|, as in tests/golden/README.md. Returns infinity if NaN or infinity differ.
inline double relative_error(std::span<const float> a, std::span<const float> b) {
  if (a.size() != b.size()) return INFINITY;
  double worst = 0, largest = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    if (std::isfinite(a[i]) && std::isfinite(b[i])) {
      worst = std::max(worst, std::abs(static_cast<double>(a[i]) - b[i]));
      largest = std::max(largest, std::abs(static_cast<double>(b[i])));
    } else if (!(std::isnan(a[i]) && std::isnan(b[i])) && a[i] != b[i]) {
      return INFINITY;
    }
  }
  return largest > 0 ? worst / largest : worst;
}

}  // namespace revisit::test
