#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace revisit {

/// Accessor for rows of floats `[n][d]` in any storage.
struct Rows {
  int64_t n = 0, d = 0;
  std::function<std::span<const float>(int64_t)> row;
};

/// One descriptor per row; row i is scan i of the data set.
struct FloatMatrix {
  int64_t n = 0, d = 0;
  std::vector<float> values;  // [n][d], C order

  FloatMatrix() = default;
  FloatMatrix(int64_t rows, int64_t columns)
      : n(rows), d(columns), values(static_cast<size_t>(rows * columns)) {}
  std::span<const float> row(int64_t i) const {
    return {values.data() + i * d, static_cast<size_t>(d)};
  }
  std::span<float> row(int64_t i) { return {values.data() + i * d, static_cast<size_t>(d)}; }
  /// Refers to this matrix.
  Rows rows() const {
    return {n, d, [this](int64_t i) { return row(i); }};
  }
};

}  // namespace revisit
