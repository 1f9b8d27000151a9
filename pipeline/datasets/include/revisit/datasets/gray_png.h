#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "revisit/recognition/gray_image.h"
#include "revisit/recognition/range_image.h"

namespace revisit::pipeline {

/// Cameras of places have fewer; what is computed from an image takes some 200 bytes a pixel.
inline constexpr int64_t kMaxImagePixels = int64_t{4} << 20;

/// Reads a PNG of any kind; colours become gray (the luminance of sRGB). Throws InputError, naming
/// the file, when it cannot be read, is not a PNG, is damaged, or has more than kMaxImagePixels.
GrayImage read_gray_png(const std::filesystem::path& file);

/// Writes an 8-bit gray PNG. The file appears whole or not at all. Throws Error when it cannot.
void write_gray_png(const std::filesystem::path& file, const GrayImage& image);
/// Writes an 8-bit grey PNG (values rounded). Throws Error when it cannot.
void write_png(const std::string& file, const RangeImage& image);

}  // namespace revisit::pipeline
