#pragma once

#include <cstdint>
#include <functional>
#include <span>

namespace revisit::pipeline {

/// How two descriptors are compared, and how candidates are chosen where comparing all takes too
/// long. An empty one compares by cosine.
struct Comparison {
  /// How alike `query` is to each of `places`, all descriptors: larger is more alike, the i-th
  /// goes to `similarities[i]`. All candidates of a query come in one call, because a probability
  /// over places needs them together. Called from several threads at once. Empty: cosine.
  std::function<void(std::span<const float> query, std::span<const std::span<const float>> places,
                     std::span<double> similarities)>
      similarity;
  /// Heading of b less heading of a, counter-clockwise [rad]. Empty: descriptors do not tell it.
  std::function<double(std::span<const float> a, std::span<const float> b)> turn;

  /// A short vector of a descriptor. The product of two of them says roughly how alike their
  /// descriptors are, in less time than their similarity. Cosines need none: there the key is the
  /// descriptor at unit length.
  std::function<void(std::span<const float> descriptor, std::span<float> key)> make_key;
  int64_t key_numbers = 0;     // of a key; 0: there are no keys
  int64_t key_candidates = 0;  // so many, those with the largest products, are compared; 0: all
};

}  // namespace revisit::pipeline
