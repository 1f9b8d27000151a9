#pragma once

#include <cstddef>

namespace revisit::proto {

struct NumberType {
  enum class Kind { kFloat, kSigned, kUnsigned, kOther } kind = Kind::kOther;
  size_t bytes = 0;
  bool big_endian = false;
};

/// Reads the number at an address, which need not be aligned.
using NumberReader = double (*)(const char*);

/// Returns null unless the type is a float of 4 or 8 bytes or an integer of 1, 2, 4 or 8 bytes.
NumberReader number_reader(const NumberType& type);

}  // namespace revisit::proto
