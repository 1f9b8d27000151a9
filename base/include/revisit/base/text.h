#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <sstream>
#include <string>
#include <string_view>

namespace revisit {

/// Formats a number with the fewest digits that restore it exactly.
std::string exact(double value);

/// The finite number that `text` is, without anything else; absent for other texts.
std::optional<double> finite_number(std::string_view text);

/// Joins the elements, or `part` of each, with `separator`, as an output stream prints them.
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

/// ASCII letters in lower case.
std::string lower(std::string text);

/// "1 scan", "2 scans".
std::string plural(int64_t count, std::string_view what);

/// "1x3x227x227"; "()" without axes.
inline std::string shape_text(std::span<const int64_t> shape) {
  return shape.empty() ? "()" : joined(shape, "x");
}

}  // namespace revisit
