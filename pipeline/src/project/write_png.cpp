#include <png.h>

#include <algorithm>
#include <cmath>

#include "revisit/pipeline/range_image.h"
#include "revisit/proto/atomic_file.h"

namespace revisit::pipeline {
namespace {

std::vector<uint8_t> to_grey(const RangeImage& image) {
  std::vector<uint8_t> grey(image.pixels.size());
  std::transform(image.pixels.begin(), image.pixels.end(), grey.begin(), [](float pixel) {
    return static_cast<uint8_t>(std::lround(std::clamp(pixel, 0.0F, 255.0F)));
  });
  return grey;
}

}  // namespace

void write_png(const std::string& file, const RangeImage& image) {
  const std::vector<uint8_t> grey = to_grey(image);
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(image.width);
  png.height = static_cast<png_uint_32>(image.height);
  png.format = PNG_FORMAT_GRAY;
  std::string bytes(PNG_IMAGE_PNG_SIZE_MAX(png), '\0');
  png_alloc_size_t size = bytes.size();
  if (!png_image_write_to_memory(&png, bytes.data(), &size, 0, grey.data(), 0, nullptr))
    throw Error(str(file, ": cannot encode ", image.width, " x ", image.height,
                    " pixels as PNG: ", png.message));
  write_atomically(file, [&](std::ostream& out) {
    out.write(bytes.data(), static_cast<std::streamsize>(size));
  });
}

}  // namespace revisit::pipeline
