#pragma once

#include <cstddef>
#include <cstdint>

namespace revisit::proto {

/// Limits on input files, far above those of published models, so that an untrusted or corrupt file
/// cannot exhaust memory. Error messages name the limit and its field here.
struct Limits {
  /// Parsed text takes up to 100 times its size in memory.
  int64_t text_bytes = int64_t{16} << 20;
  /// protobuf also limits binary caffemodels to 2^31-1 bytes.
  int64_t weight_bytes = int64_t{8} << 30;
  /// Three times the deepest published networks.
  int64_t layers = 20'000;
};

inline constexpr int64_t kMaxElements = INT32_MAX;  ///< Caffe's limit for an array
inline constexpr size_t kMaxAxes = 32;              ///< Caffe's limit for a shape
inline constexpr int kMaxNesting = 100;             ///< protobuf's limit for messages

}  // namespace revisit::proto
