#pragma once

#include <cstdint>

namespace revisit::engine {

/// Columns of a matrix product that are summed in registers at a time: with two blocks of output
/// channels, 28 of AVX-512's 32 registers. Targets with fewer registers take a part of it.
constexpr int64_t kMaxColumns = 14;

/// Columns [0, count) cut into the fewest strips of at most kMaxColumns, equal to within one.
struct Strips {
  int64_t count;

  int64_t size() const { return (count + kMaxColumns - 1) / kMaxColumns; }
  int64_t begin(int64_t strip) const { return count * strip / size(); }
  int64_t width(int64_t strip) const { return begin(strip + 1) - begin(strip); }
};

}  // namespace revisit::engine
