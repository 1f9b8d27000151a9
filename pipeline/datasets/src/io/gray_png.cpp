#include <png.h>

#include <algorithm>
#include <cmath>

#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/datasets/scan_file.h"

namespace revisit {
namespace {

struct PngImage : png_image {
  PngImage() : png_image{} { version = PNG_IMAGE_VERSION; }
  ~PngImage() { png_image_free(this); }
  PngImage(const PngImage&) = delete;
  PngImage& operator=(const PngImage&) = delete;
};

}  // namespace

GrayImage read_gray_png(const std::filesystem::path& file) {
  const std::string bytes = read_content(file);
  PngImage png;
  if (!png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()))
    throw InputError(file.string(), ": not a PNG image: ", png.message);
  const int64_t pixels = int64_t{png.width} * png.height;
  if (pixels > kMaxImagePixels)
    throw InputError(file.string(), ": ", png.width, " x ", png.height,
                     " pixels, expected at most ", kMaxImagePixels, "; reduce the image");
  png.format = PNG_FORMAT_GRAY;
  // Transparent pixels keep the buffer's value: black.
  GrayImage image{static_cast<int>(png.width), static_cast<int>(png.height),
                  std::vector<uint8_t>(static_cast<size_t>(pixels))};
  if (!png_image_finish_read(&png, nullptr, image.pixels.data(), 0, nullptr))
    throw InputError(file.string(), ": the PNG image is corrupt: ", png.message);
  return image;
}

GrayImage gray_of(const RangeImage& image) {
  GrayImage gray{image.width, image.height, std::vector<uint8_t>(image.pixels.size())};
  std::transform(image.pixels.begin(), image.pixels.end(), gray.pixels.begin(), [](float pixel) {
    return static_cast<uint8_t>(std::lround(std::clamp(pixel, 0.0F, 255.0F)));
  });
  return gray;
}

std::string png_of(const GrayImage& image, const std::string& what) {
  PngImage png;
  png.width = static_cast<png_uint_32>(image.width);
  png.height = static_cast<png_uint_32>(image.height);
  png.format = PNG_FORMAT_GRAY;
  std::string bytes(PNG_IMAGE_PNG_SIZE_MAX(png), '\0');
  png_alloc_size_t size = bytes.size();
  if (!png_image_write_to_memory(&png, bytes.data(), &size, 0, image.pixels.data(), 0, nullptr))
    throw Error(what, ": cannot encode ", image.width, " x ", image.height,
                " pixels as PNG: ", png.message);
  bytes.resize(size);
  return bytes;
}

void write_gray_png(const std::filesystem::path& file, const GrayImage& image) {
  const std::string bytes = png_of(image, file.string());
  write_atomically(file, [&](std::ostream& out) { out << bytes; });
}

}  // namespace revisit
