#include "revisit/recognition/match.h"

#include <algorithm>
#include <cmath>

#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit {
namespace {

// Names in the order of Score.
constexpr const char* kScores[] = {"margin", "distinct-margin", "similarity", "verified"};
// Names in the order of Exclusion::Kind.
constexpr const char* kExclusions[] = {"none", "frames", "seconds", "meters"};

}  // namespace

Score parse_score(const std::string& text) {
  const auto* const found = std::ranges::find(kScores, text);
  if (found == std::end(kScores))
    throw UsageError("score: expected margin, distinct-margin or similarity, found '", text, "'");
  return static_cast<Score>(found - kScores);
}

const char* name_of(Score score) {
  return kScores[static_cast<size_t>(score)];
}

Exclusion parse_exclusion(const std::string& text, const char* what) {
  if (text == "none") return {Exclusion::Kind::kNone, 0};
  const size_t equals = text.find('=');
  const std::string kind = text.substr(0, equals);
  const std::optional<double> amount =
      equals == std::string::npos ? std::nullopt : finite_number(text.substr(equals + 1));
  const auto* const found = std::ranges::find(kExclusions, kind);
  const bool is_kind = found != std::end(kExclusions);
  Exclusion exclusion{.amount = amount.value_or(-1)};
  if (is_kind) exclusion.kind = static_cast<Exclusion::Kind>(found - kExclusions);
  const bool is_number = exclusion.amount >= 0;
  const bool is_whole = is_number && exclusion.amount == std::floor(exclusion.amount);
  if (is_kind && exclusion.kind != Exclusion::Kind::kNone &&
      (exclusion.kind == Exclusion::Kind::kFrames ? is_whole : is_number))
    return exclusion;
  throw UsageError(
      what, ": expected frames=N, seconds=T, meters=L (not negative) or none, found '", text, "'",
      is_kind ? "" : nearest_name_hint(kind, {std::begin(kExclusions), std::end(kExclusions)}));
}

std::string to_string(const Exclusion& exclusion) {
  const std::string kind = kExclusions[static_cast<size_t>(exclusion.kind)];
  return exclusion.kind == Exclusion::Kind::kNone ? kind : kind + "=" + exact(exclusion.amount);
}

double ExclusionCounter::at(int64_t frame, const std::optional<double>& time,
                            const std::optional<Eigen::Vector3d>& position,
                            const std::optional<double>& registered) {
  if (exclusion_.kind == Exclusion::Kind::kSeconds) {
    if (!time) throw UsageError("exclusion in seconds: the scans have no times; use frames=N");
    return *time;
  }
  if (exclusion_.kind != Exclusion::Kind::kMeters) return static_cast<double>(frame);
  constexpr double kHalt = 0.5;  // [m]
  constexpr double kScans = 50;  // of unknown motion, that are excluded
  if (!position) {
    meters_ += registered.value_or(exclusion_.amount / kScans);
    reference_.reset();
    return meters_;
  }
  const double moved = reference_ ? (*position - *reference_).norm() : 0;
  if (reference_) meters_ = std::max(meters_, base_ + moved);
  if (!reference_ || moved >= kHalt) {
    reference_ = position;
    base_ = meters_;
  }
  return meters_;
}

}  // namespace revisit
