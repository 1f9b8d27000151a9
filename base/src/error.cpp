#include "revisit/base/error.h"

#include <algorithm>
#include <cctype>
#include <numeric>

namespace revisit {
namespace {

size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<size_t> row(b.size() + 1), above(row), two_above(row);
  std::iota(row.begin(), row.end(), size_t{0});
  for (size_t i = 1; i <= a.size(); ++i) {
    two_above.swap(above);
    above.swap(row);
    row[0] = i;
    for (size_t j = 1; j <= b.size(); ++j) {
      const size_t substituted = above[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      row[j] = std::min({above[j] + 1, row[j - 1] + 1, substituted});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        row[j] = std::min(row[j], two_above[j - 2] + 1);
    }
  }
  return row.back();
}

bool differ_in_case(std::string_view a, std::string_view b) {
  const auto lower = [](unsigned char c) { return std::tolower(c); };
  return std::ranges::equal(a, b, {}, lower, lower);
}

std::string nearest_within(size_t most, std::string_view wanted,
                           const std::vector<std::string>& candidates) {
  constexpr size_t kMaxName = 200;  // bounds the cost on untrusted input
  if (wanted.size() > kMaxName) return "";
  const auto is_same_name = [&](const std::string& candidate) {
    return differ_in_case(wanted, candidate);
  };
  const bool by_case = std::ranges::any_of(candidates, is_same_name);
  std::string best;
  size_t best_distance = (by_case ? wanted.size() : most) + 1;
  for (const std::string& candidate : candidates) {
    if (by_case && !is_same_name(candidate)) continue;
    if (candidate.size() > kMaxName || candidate.size() >= wanted.size() + best_distance ||
        wanted.size() >= candidate.size() + best_distance)
      continue;
    const size_t distance = edit_distance(wanted, candidate);
    if (distance < best_distance) {
      best_distance = distance;
      best = candidate;
    }
  }
  return best;
}

std::string hint(const std::string& near) {
  return near.empty() ? "" : " (did you mean '" + near + "'?)";
}

}  // namespace

std::string nearest_name(std::string_view wanted, const std::vector<std::string>& candidates) {
  return nearest_within(wanted.size() / 3, wanted, candidates);
}

std::string nearest_name_hint(std::string_view wanted, const std::vector<std::string>& candidates) {
  return hint(nearest_name(wanted, candidates));
}

std::string misspelling_hint(std::string_view wanted, const std::vector<std::string>& candidates,
                             size_t common) {
  const size_t letters = wanted.size() - common;
  return hint(nearest_within(letters < 3 ? 0 : letters < 8 ? 1 : 2, wanted, candidates));
}

}  // namespace revisit
