#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <sstream>
#include <string>
#include <string_view>

namespace revisit {

/// The elements, or `part` of each, as an output stream prints them, `separator` between them.
template <class Range, class Part = std::identity>
std::string joined(const Range& range, std::string_view separator, Part part = {}) {
  std::ostringstream out;
  std::string_view before;
  for (const auto& element : range) {
    out << before << std::invoke(part, element);
    before = separator;
  }
  return std::move(out).str();
}

/// "1x3x227x227"; "()" for no axes.
inline std::string shape_text(std::span<const int64_t> shape) {
  return shape.empty() ? "()" : joined(shape, "x");
}

}  // namespace revisit
