#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>

#include "revisit/recognition/candidate_source.h"

namespace revisit::pipeline {

/// How two descriptors are compared and candidates chosen; an empty one compares all by cosine.
struct Comparison {
  /// How alike `query` is to each of `places`, all descriptors: larger is more alike, the i-th
  /// goes to `similarities[i]`. All candidates of a query come in one call, because a probability
  /// over places needs them together. Called from several threads at once. Empty: cosine.
  std::function<void(std::span<const float> query, std::span<const std::span<const float>> places,
                     std::span<double> similarities)>
      similarity;
  /// Two places at least so similar count as one: seen from the next frame, in another pass or
  /// while standing. Absent: similarities do not tell.
  std::optional<double> same_place;
  /// Heading of b less heading of a, counter-clockwise [rad]. Empty: descriptors do not tell it.
  std::function<double(std::span<const float> a, std::span<const float> b)> turn;

  /// Makes an empty source that compares keys, rough copies of descriptors. Empty: no keys.
  std::function<std::unique_ptr<CandidateSource>()> keys;
  int64_t key_candidates = 0;  // so many of them, the most similar, are compared; 0: all places

  double similarity_of(std::span<const float> a, std::span<const float> b) const;
};

}  // namespace revisit::pipeline
