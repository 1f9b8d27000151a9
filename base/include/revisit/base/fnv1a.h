#pragma once

#include <cstdint>

namespace revisit {

constexpr uint64_t kFnv1aStart = 0xCBF29CE484222325;
/// The hash of what was hashed so far and one more byte, or word: FNV-1a, 64 bits.
constexpr uint64_t fnv1a(uint64_t hash, uint32_t next) {
  return (hash ^ next) * 0x100000001B3;
}

}  // namespace revisit
