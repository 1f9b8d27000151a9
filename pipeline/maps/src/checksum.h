#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <string_view>

#include "revisit/base/hash.h"

namespace revisit {

/// Each update is bijective, so that any change within a single word is detected.
class Checksum {
 public:
  Checksum& number(int64_t value) {
    const uint64_t bits = std::bit_cast<uint64_t>(value);
    hash_ = fnv1a(hash_, static_cast<uint32_t>(bits));
    hash_ = fnv1a(hash_, static_cast<uint32_t>(bits >> 32));
    return *this;
  }

  Checksum& bytes(std::string_view bytes) {
    number(static_cast<int64_t>(bytes.size()));
    for (; !bytes.empty(); bytes.remove_prefix(bytes.size() < 4 ? bytes.size() : 4)) {
      uint32_t word = 0;
      std::memcpy(&word, bytes.data(), bytes.size() < 4 ? bytes.size() : 4);
      hash_ = fnv1a(hash_, word);
    }
    return *this;
  }

  /// Signed, as SQLite stores integers.
  int64_t value() const { return std::bit_cast<int64_t>(hash_); }

 private:
  uint64_t hash_ = kFnv1aStart;
};

}  // namespace revisit
