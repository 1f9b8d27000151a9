#pragma once

#include <hwy/aligned_allocator.h>

#include <array>
#include <vector>

#include "revisit/recognition/candidate_source.h"
#include "revisit/recognition/ring/match.h"
#include "ring/key_products.h"

namespace revisit::pipeline {

/// Proposes places by keys, rough copies of rings: of every frequency some numbers, evenly from
/// those worth most to least, a byte each. All keys are compared, at kKeyTurns turns.
class RingKeys : public CandidateSource {
 public:
  explicit RingKeys(const RingLayout& layout);

  int64_t size() const override { return size_; }
  void add(std::span<const float> descriptor) override;
  void find(std::span<const float> query, std::span<const CandidateRange> among, int64_t count,
            int threads, std::vector<int64_t>& places) const override;

 private:
  /// Of kPlacesInBlock places.
  struct Block {
    hwy::AlignedFreeUniquePtr<uint8_t[]> keys;  // [places / kKeysTogether][numbers][kKeysTogether]
    std::vector<float> scales;                  // of places that are not there: 0
  };
  /// What finding takes, kept by the thread for its next query.
  struct Memory;

  /// The parts of `descriptor` that a key has, rounded to whole ones of at most `largest` ->
  /// `parts` [numbers][2]. Returns their scale; 0 when all are zero.
  float round_parts(std::span<const float> descriptor, int largest, std::span<int16_t> parts) const;

  /// Where the real and the imaginary part of each number are in a descriptor.
  std::vector<std::array<size_t, 2>> numbers_;
  std::array<int, kRingFrequencies> counts_{};  // numbers of each frequency
  int largest_of_query_ = 0;                    // part: no sum of products overflows
  std::vector<Block> blocks_;
  int64_t size_ = 0;
};

}  // namespace revisit::pipeline
