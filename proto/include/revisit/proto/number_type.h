#pragma once

#include <cstddef>

namespace revisit::proto {

/// How a file stores a number.
struct NumberType {
  enum class Kind { kFloat, kSigned, kUnsigned, kOther } kind = Kind::kOther;
  size_t bytes = 0;
  bool big_endian = false;
};

/// Reads the number that begins at a byte, which need not be aligned.
using NumberReader = double (*)(const char*);

/// Null for what is neither a float of 4 or 8 bytes nor an integer of 1, 2, 4 or 8.
NumberReader number_reader(const NumberType& type);

}  // namespace revisit::proto
