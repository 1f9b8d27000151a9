#pragma once

#include <hwy/aligned_allocator.h>

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "revisit/recognition/match.h"
#include "revisit/recognition/ring/descriptor.h"
#include "ring/correlation.h"

namespace revisit {

/// Codes of this many places are interleaved, coefficient by coefficient.
inline constexpr int64_t kCodesPerGroup = 32;
inline constexpr int kCodeYaws = 32;
/// A quarter revolution: at -t the sines change sign; at 180 deg - t the odd frequencies, too.
using CodeWaves = RingWaves<kCodeYaws, kCodeYaws / 4 + 1>;
/// Real and imaginary parts of a code are in -kMaxPart .. kMaxPart, 4 bits each in a byte,
/// real part in the low bits.
inline constexpr int kMaxPart = 7;

struct CodeQuery {
  std::array<int, kRingFrequencies> counts{};  // [frequency], complex coefficients of a code
  /// Real and imaginary part of each coefficient, rounded. For each frequency, count * 2 *
  /// kMaxPart * (largest part) < 2^15, so that int16 sums cannot overflow.
  std::vector<int16_t> parts;
};

/// Computes the largest correlation of `query` with each code over kCodeYaws yaw angles, multiplied
/// by the code's scale. `codes` is [groups][coefficients][kCodesPerGroup], aligned to
/// kCodesPerGroup bytes; `scales` and `largest` are [groups * kCodesPerGroup].
void max_code_products(const CodeQuery& query, const uint8_t* codes, std::span<const float> scales,
                       std::span<float> largest);

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
    hwy::AlignedFreeUniquePtr<uint8_t[]> codes;  // [group][coefficients][kCodesPerGroup]
    std::vector<float> scales;                   // 0 beyond the last place
  };
  /// Working memory of find(), kept by the thread for its next query.
  struct Memory;

  /// Writes the code's parts of `descriptor`, rounded to integers of at most `largest`, to `parts`
  /// [coefficients][2]. Returns their scale; 0 if all are zero.
  float round_parts(std::span<const float> descriptor, int largest, std::span<int16_t> parts) const;

  /// Indices of the real and the imaginary part of each coefficient in a descriptor.
  std::vector<std::array<size_t, 2>> coefficients_;
  std::array<int, kRingFrequencies> counts_{};  // [frequency], coefficients
  int largest_of_query_ = 0;  // largest part for which no sum of products overflows
  std::vector<Block> blocks_;
  int64_t size_ = 0;
};

}  // namespace revisit
