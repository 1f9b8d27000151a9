#pragma once

#include <cstdint>

namespace revisit {

constexpr uint64_t kFnv1aStart = 0xCBF29CE484222325;
/// 64-bit FNV-1a: extends the hash by one byte or word.
constexpr uint64_t fnv1a(uint64_t hash, uint32_t next) {
  return (hash ^ next) * 0x100000001B3;
}

}  // namespace revisit
