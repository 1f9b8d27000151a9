#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

namespace revisit::cli {

struct Picture {
  static constexpr int64_t kMaxPixels = int64_t{64} << 20;

  int width = 0, height = 0, channels = 0;
  std::vector<uint8_t> pixels;  // [height][width][channels], BGR or gray
};

/// Reads a PNG or JPEG file with 3 channels or 1 (gray) as OpenCV's imread(), without EXIF
/// rotation: drops transparency, converts 16 bits to 8. Throws InputError, also beyond kMaxPixels.
Picture read_picture(const std::filesystem::path& file, int channels);

}  // namespace revisit::cli
