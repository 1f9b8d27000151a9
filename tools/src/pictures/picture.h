#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

namespace revisit::cli {

struct Picture {
  static constexpr int64_t kMostPixels = int64_t{64} << 20;

  int width = 0, height = 0;
  std::vector<uint8_t> bgr;  // [height][width][3]
};

/// Reads a PNG or JPEG file as OpenCV's imread() does, but for EXIF: gray becomes three equal
/// channels, transparency is dropped, 16 bits become 8. Throws InputError, also beyond kMostPixels.
Picture read_picture(const std::filesystem::path& file);

}  // namespace revisit::cli
