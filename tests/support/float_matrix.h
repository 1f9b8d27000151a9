#pragma once

#include <algorithm>
#include <initializer_list>
#include <random>
#include <span>
#include <vector>

#include "revisit/recognition/matrix.h"

namespace revisit::test {

inline FloatMatrix matrix(std::initializer_list<std::initializer_list<float>> rows) {
  FloatMatrix m(static_cast<int64_t>(rows.size()), static_cast<int64_t>(rows.begin()->size()));
  int64_t i = 0;
  for (const auto& row : rows) std::copy(row.begin(), row.end(), m.row(i++).begin());
  return m;
}

inline FloatMatrix random_matrix(int64_t n, int64_t d, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  FloatMatrix m(n, d);
  for (float& value : m.values) value = normal(random);
  return m;
}

inline std::vector<std::span<const float>> rows_of(const FloatMatrix& m,
                                                   std::span<const int64_t> rows) {
  std::vector<std::span<const float>> places;
  for (const int64_t row : rows) places.push_back(m.row(row));
  return places;
}

inline double cosine_of(std::span<const float> a, std::span<const float> b) {
  return cosine(a, length_of(a), b, length_of(b));
}

}  // namespace revisit::test
