#pragma once

#include <hwy/aligned_allocator.h>

#include <array>
#include <vector>

#include "revisit/recognition/candidate_source.h"
#include "revisit/recognition/ring/match.h"
#include "ring/key_products.h"

namespace revisit {

/// Proposes places by compact codes of descriptors. A code has some coefficients of every
/// frequency, evenly spaced from largest to smallest eigenvalue, one byte each. All codes are
/// compared, at kCodeYaws yaw angles.
class RingCodes : public CandidateSource {
 public:
  explicit RingCodes(const RingLayout& layout);

  int64_t size() const override { return size_; }
  void add(std::span<const float> descriptor) override;
  void find(std::span<const float> query, std::span<const CandidateRange> among, int64_t count,
            int threads, std::vector<int64_t>& places) const override;

 private:
  struct Block {
    hwy::AlignedFreeUniquePtr<uint8_t[]> keys;  // [group][coefficients][kCodesPerGroup]
    std::vector<float> scales;                  // 0 beyond the last place
  };
  /// Working memory of find(), kept by the thread for its next query.
  struct Memory;

  /// Writes the code's parts of `descriptor`, rounded to integers of at most `largest`, to `parts`
  /// [coefficients][2]. Returns their scale; 0 if all are zero.
  float round_parts(std::span<const float> descriptor, int largest, std::span<int16_t> parts) const;

  /// Indices of the real and the imaginary part of each coefficient in a descriptor.
  std::vector<std::array<size_t, 2>> numbers_;
  std::array<int, kRingFrequencies> counts_{};  // [frequency], coefficients
  int largest_of_query_ = 0;  // largest part for which no sum of products overflows
  std::vector<Block> blocks_;
  int64_t size_ = 0;
};

}  // namespace revisit
