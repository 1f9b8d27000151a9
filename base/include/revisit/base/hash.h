#pragma once

#include <cstdint>
#include <string>

namespace revisit {

constexpr uint64_t kFnv1aStart = 0xCBF29CE484222325;  ///< first `hash` of fnv1a()
/// 64-bit FNV-1a: extends the hash by one byte or word.
constexpr uint64_t fnv1a(uint64_t hash, uint32_t next) {
  return (hash ^ next) * 0x100000001B3;
}

/// Returns a hash of the text, 16 hexadecimal digits. It is not cryptographic; compare the texts
/// where collisions matter.
std::string short_name_of(const std::string& text);

/// splitmix64 (Steele, Lea, Flood 2014): the same numbers on every platform.
constexpr uint64_t kSplitmixStep = 0x9E3779B97F4A7C15;
/// Output function of splitmix64.
constexpr uint64_t mixed_bits(uint64_t z) {
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EB;
  return z ^ (z >> 31);
}

/// Element `index` of the sequence with seed `key`, in [0, 1).
constexpr double unit_number(uint64_t key, uint64_t index) {
  return static_cast<double>(mixed_bits(key + (index + 1) * kSplitmixStep) >> 11) * 0x1.0p-53;
}

}  // namespace revisit
