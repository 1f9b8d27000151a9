#include "revisit/base/error.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace revisit {
namespace {

/// Levenshtein distance, by rows.
size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), size_t{0});
  for (size_t i = 1; i <= a.size(); ++i) {
    size_t diagonal = std::exchange(row[0], i);
    for (size_t j = 1; j <= b.size(); ++j) {
      const size_t substituted = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = std::exchange(row[j], std::min({row[j] + 1, row[j - 1] + 1, substituted}));
    }
  }
  return row.back();
}

/// The first of the nearest candidates that are at most `most` edits away.
std::string nearest_within(size_t most, std::string_view wanted,
                           const std::vector<std::string>& candidates) {
  constexpr size_t kLongestName = 200;  // bounds the work on hostile input
  if (wanted.size() > kLongestName) return "";
  std::string best;
  size_t best_distance = most + 1;
  for (const std::string& candidate : candidates) {
    if (candidate.size() > kLongestName || candidate.size() >= wanted.size() + best_distance ||
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

Error::Error(const std::string& message) : Error(Pieces(message)) {}
Error::Error(const char* message) : Error(Pieces(message)) {}
Error::Error(Pieces&& pieces)
    : std::runtime_error(pieces.text([](const std::string& name) { return name; })),
      pieces_(std::move(pieces)) {}

std::string Error::Pieces::text(const Words& word) const {
  std::string text;
  for (const Piece& piece : *this) text += piece.is_name ? word(piece.text) : piece.text;
  return text;
}

std::string nearest_name(std::string_view wanted, const std::vector<std::string>& candidates) {
  return nearest_within(std::max<size_t>(2, wanted.size() / 3), wanted, candidates);
}

std::string did_you_mean(std::string_view wanted, const std::vector<std::string>& candidates) {
  return hint(nearest_name(wanted, candidates));
}

std::string did_you_misspell(std::string_view wanted, const std::vector<std::string>& candidates) {
  return hint(nearest_within(wanted.size() < 8 ? 1 : 2, wanted, candidates));
}

}  // namespace revisit
