#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>

#include "revisit/recognition/candidate_source.h"

namespace revisit {

struct Comparison {
  /// Larger is more similar. One call has all candidates of a query, because a probability over
  /// places needs them together. Must be thread-safe. Empty: cosine.
  std::function<void(std::span<const float> query, std::span<const std::span<const float>> places,
                     std::span<double> similarities)>
      similarity;
  /// Places with at least this similarity count as one: consecutive frames, another pass, or a
  /// standing sensor. Absent: similarities do not identify a place.
  std::optional<double> same_place;
  /// Returns yaw(b) - yaw(a), counter-clockwise [rad]. Empty: descriptors do not determine it.
  std::function<double(std::span<const float> a, std::span<const float> b)> relative_yaw;

  /// Makes an empty source that compares compact codes of descriptors. Empty: no codes.
  std::function<std::unique_ptr<CandidateSource>()> keys;
  int64_t code_candidates = 0;  // number of candidates preselected by the codes; 0: all places

  double similarity_of(std::span<const float> a, std::span<const float> b) const;
};

}  // namespace revisit
