#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

namespace revisit::cli {

struct Picture {
  static constexpr int64_t kMostPixels = int64_t{64} << 20;

  int width = 0, height = 0, channels = 0;
  std::vector<uint8_t> pixels;  // [height][width][channels], BGR or gray
};

/// Reads a PNG or JPEG file as OpenCV's imread() does, but for EXIF, in 3 channels or in 1, gray:
/// transparency is dropped, 16 bits become 8. Throws InputError, also beyond kMostPixels.
Picture read_picture(const std::filesystem::path& file, int channels);

}  // namespace revisit::cli
