#pragma once

#include <cstddef>
#include <cstdint>

namespace revisit::proto {

/// What a file may ask for before it is refused: far beyond honest models, so that a hostile or
/// damaged one cannot take the machine's memory. Each message names its limit and the field here.
struct Limits {
  /// Of a network description. Text costs up to 100 times its size in memory.
  int64_t text_bytes = int64_t{16} << 20;
  /// Of a weights file. (A binary caffemodel ends at 2^31-1 bytes in any case, protobuf's limit.)
  int64_t weight_bytes = int64_t{8} << 30;
  /// Of a network: three times the deepest published ones.
  int64_t layers = 20'000;
};

/// Of one array: Caffe's own limit.
inline constexpr int64_t kMostElements = INT32_MAX;
/// Of the shape of one: the same.
inline constexpr size_t kMostAxes = 32;
/// Of messages inside messages: protobuf's own limit.
inline constexpr int kDeepestNesting = 100;

}  // namespace revisit::proto
