#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "revisit/recognition/gray_image.h"
#include "revisit/recognition/range_image.h"

namespace revisit {

/// Upper limit of an image's pixels; computing from an image takes some 200 bytes per pixel.
inline constexpr int64_t kMaxImagePixels = int64_t{4} << 20;

/// Reads any PNG as gray (luminance of sRGB). Throws InputError, also above kMaxImagePixels.
GrayImage read_gray_png(const std::filesystem::path& file);

GrayImage gray_of(const RangeImage& image);  // rounded

/// Throws Error with `what`.
std::string png_of(const GrayImage& image, const std::string& what);

/// Write atomically. Throw Error on failure.
void write_gray_png(const std::filesystem::path& file, const GrayImage& image);
void write_png(const std::string& file, const RangeImage& image);

}  // namespace revisit
