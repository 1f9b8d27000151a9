#include "revisit/base/text.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>

#include "revisit/base/error.h"
#include "revisit/base/hash.h"

namespace revisit {

std::string exact(double value) {
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

std::optional<double> finite_number(std::string_view text) {
  double number = 0;
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, number);
  if (error != std::errc() || stop != end || !std::isfinite(number)) return std::nullopt;
  return number;
}

std::string lower(std::string text) {
  std::ranges::transform(text, text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

std::string plural(int64_t count, std::string_view what) {
  return str(count, " ", what, count == 1 ? "" : "s");
}

std::string short_name_of(const std::string& text) {
  uint64_t hash = kFnv1aStart;
  for (const unsigned char c : text) hash = fnv1a(hash, c);
  std::string digits(16, '0');
  for (size_t i = digits.size(); i-- > 0; hash >>= 4) digits[i] = "0123456789abcdef"[hash & 15];
  return digits;
}

}  // namespace revisit
