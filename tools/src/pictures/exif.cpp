#include "pictures/exif.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace revisit::cli {
namespace {

/// Bytes of a TIFF file, the format of EXIF; bytes beyond its end are 0.
struct Tiff {
  std::string_view bytes;

  uint32_t number(size_t at, size_t size) const {
    const bool is_little_endian = bytes.starts_with("II");
    uint32_t value = 0;
    for (size_t i = 0; i < size; ++i) {
      const size_t place = at + (is_little_endian ? size - 1 - i : i);
      value = value << 8 | (place < bytes.size() ? static_cast<uint8_t>(bytes[place]) : 0);
    }
    return value;
  }
};

}  // namespace

int exif_orientation(std::string_view marker) {
  constexpr std::string_view kExif{"Exif\0\0", 6};
  constexpr size_t kEntry = 12;
  constexpr uint32_t kVersion = 42, kOrientation = 0x0112, kShort = 3;
  if (!marker.starts_with(kExif)) return 1;
  const Tiff tiff{marker.substr(kExif.size())};
  if (tiff.number(2, 2) != kVersion) return 1;
  const size_t directory = tiff.number(4, 4);
  const size_t begin = directory + 2;
  const size_t end = std::min(begin + tiff.number(directory, 2) * kEntry, tiff.bytes.size());
  for (size_t entry = begin; entry < end; entry += kEntry) {
    const uint32_t value = tiff.number(entry + 8, 2);
    if (tiff.number(entry, 2) == kOrientation && tiff.number(entry + 2, 2) == kShort)
      return value >= 1 && value <= 8 ? static_cast<int>(value) : 1;
  }
  return 1;
}

}  // namespace revisit::cli
