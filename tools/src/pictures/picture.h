#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "revisit/engine/tensor.h"
#include "revisit/proto/npy.h"

namespace revisit::cli {

struct Picture {
  static constexpr int64_t kMaxPixels = int64_t{64} << 20;

  int width = 0, height = 0, channels = 0;
  std::vector<uint8_t> pixels;  // [height][width][channels], BGR or gray
};

/// Reads a PNG or JPEG file with 3 channels or 1 (gray) as OpenCV's imread(), without EXIF
/// rotation: drops transparency, converts 16 bits to 8. Throws InputError, also beyond kMaxPixels.
Picture read_picture(const std::filesystem::path& file, int channels);

/// Orientation, 1 (upright) to 8, in the content of a JPEG file's marker APP1; 1 if there is none.
int exif_orientation(std::string_view marker);

/// Pictures resized to the input of a net: [pictures][c][h][w], values 0 to 255, BGR or RGB.
/// `input`: shape of the net's input `blob`, [n][c][h][w] with c = 3, or 1 for gray pictures.
/// Throws UsageError for another shape, InputError for a file that is no picture.
proto::Blob picture_input(const std::vector<std::filesystem::path>& files, const std::string& blob,
                          const engine::Shape& input, bool rgb);

}  // namespace revisit::cli
