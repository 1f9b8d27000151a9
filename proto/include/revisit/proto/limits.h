#pragma once

#include <cstddef>
#include <cstdint>

namespace revisit::proto {

/// Limits on input files, far above those of published models, so that an untrusted or corrupt file
/// cannot exhaust memory. Error messages name the limit and its field here.
struct Limits {
  /// Size of a network description. Parsed text takes up to 100 times its size in memory.
  int64_t text_bytes = int64_t{16} << 20;
  /// Size of a weights file. protobuf also limits binary caffemodels to 2^31-1 bytes.
  int64_t weight_bytes = int64_t{8} << 30;
  /// Layers of a network: three times the deepest published ones.
  int64_t layers = 20'000;
};

/// Maximum elements of an array: Caffe's own limit.
inline constexpr int64_t kMaxElements = INT32_MAX;
/// Maximum axes of a shape: Caffe's own limit.
inline constexpr size_t kMaxAxes = 32;
/// Maximum depth of nested messages: protobuf's own limit.
inline constexpr int kMaxNesting = 100;

}  // namespace revisit::proto
