#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "revisit/base/files.h"

static_assert(std::endian::native == std::endian::little, "only big-endian numbers are swapped");

namespace revisit {
namespace {

template <class Stored, bool kBigEndian>
double read(const char* bytes) {
  std::array<char, sizeof(Stored)> own;
  std::copy_n(bytes, own.size(), own.begin());
  if constexpr (kBigEndian) std::reverse(own.begin(), own.end());
  Stored value;
  std::memcpy(&value, own.data(), sizeof value);
  return static_cast<double>(value);
}

struct Known {
  char kind;
  size_t bytes;
  NumberReader little_endian, big_endian;
};

template <class Stored>
constexpr Known known() {
  return {std::is_floating_point_v<Stored> ? 'f'
          : std::is_signed_v<Stored>       ? 'i'
                                           : 'u',
          sizeof(Stored), read<Stored, false>, read<Stored, true>};
}

constexpr Known kKnown[] = {
    known<float>(),    known<double>(),  known<int8_t>(),   known<uint8_t>(), known<int16_t>(),
    known<uint16_t>(), known<int32_t>(), known<uint32_t>(), known<int64_t>(), known<uint64_t>()};

}  // namespace

NumberReader number_reader(const NumberType& type) {
  for (const Known& k : kKnown)
    if (k.kind == type.kind && k.bytes == type.bytes)
      return type.big_endian ? k.big_endian : k.little_endian;
  return nullptr;
}

}  // namespace revisit
