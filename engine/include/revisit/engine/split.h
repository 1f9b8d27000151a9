#pragma once

#include <algorithm>
#include <cstdint>

namespace revisit::engine {

/// Splits `items` into `parts` parts that are equal to within one `unit`; all but the last have
/// full units.
struct Split {
  int64_t items, parts, unit = 1;

  int64_t units() const { return (items + unit - 1) / unit; }
  int64_t begin(int64_t part) const { return std::min(units() * part / parts * unit, items); }
  int64_t end(int64_t part) const { return begin(part + 1); }
  int64_t width(int64_t part) const { return end(part) - begin(part); }
  int64_t widest() const { return (units() + parts - 1) / parts * unit; }
};

}  // namespace revisit::engine
