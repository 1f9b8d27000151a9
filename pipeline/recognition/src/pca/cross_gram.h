#pragma once

#include <cstdint>
#include <vector>

#include "feature_panels.h"

namespace revisit {

/// X F^T, where X are all rows and F the fitted ones: [m][m] of the fitted rows (upper triangle)
/// and [n - m][m] of the others. Products of up to kPanelColumns columns are in float, their sums
/// in double. Any number of threads gives the same bits.
struct CrossGram {
  int64_t n, m;
  std::vector<double> fitted, others;

  CrossGram(int64_t rows, int64_t fitted_rows)
      : n(rows), m(fitted_rows), fitted(m * m), others((n - m) * m) {}

  static int64_t bytes(int64_t n, int64_t m, int threads);
  /// Adds the products of a panel whose first m rows are the fitted ones.
  void add(const Panel& panel, int threads);
};

}  // namespace revisit
