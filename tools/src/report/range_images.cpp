#include <openssl/evp.h>

#include <algorithm>
#include <cmath>

#include "report/report.h"
#include "revisit/base/error.h"
#include "revisit/datasets/describe.h"
#include "revisit/datasets/scan_file.h"

namespace revisit::cli {
namespace {

constexpr int kMaxWidth = 800, kMaxHeight = 56;  // [pixels], maximum
constexpr float kLevels = 32;                    // fewer gray values make smaller files

RangeImage reduced(const RangeImage& image) {
  RangeImage small;
  small.width = std::min(image.width, kMaxWidth);
  small.height = std::min(image.height, kMaxHeight);
  for (int row = 0; row < small.height; ++row)
    for (int column = 0; column < small.width; ++column) {
      float sum = 0, count = 0;
      for (int y = row * image.height / small.height; y < (row + 1) * image.height / small.height;
           ++y)
        for (int x = column * image.width / small.width;
             x < (column + 1) * image.width / small.width; ++x)
          if (image.at(y, x) > 0) sum += image.at(y, x), ++count;
      const float mean = count > 0 ? sum / count : 0;
      small.pixels.push_back(std::ceil(mean * kLevels / 255) * 255 / kLevels);
    }
  return small;
}

ImageGeometry geometry_of(const reports::RunInfo& info) {
  ImageGeometry g;
  g.width = info.image_width();
  g.height = info.image_height();
  g.elevation_top = info.elevation_top_deg();
  g.elevation_bottom = info.elevation_bottom_deg();
  g.max_range = info.max_range_m();
  g.closing_width = info.closing_width() * 360.0 / g.width;
  g.closing_height = info.closing_height() * (g.elevation_top - g.elevation_bottom) / g.height;
  return g;
}

std::string png_uri(const RangeImage& image) {
  const std::string png = png_of(gray_of(image), "range image");
  std::string text((png.size() + 2) / 3 * 4 + 1, '\0');  // with the final 0 of OpenSSL
  text.resize(static_cast<size_t>(EVP_EncodeBlock(reinterpret_cast<uint8_t*>(text.data()),
                                                  reinterpret_cast<const uint8_t*>(png.data()),
                                                  static_cast<int>(png.size()))));
  return "data:image/png;base64," + text;
}

}  // namespace

std::string RangeImages::add(const std::string& scan_file, const reports::RunInfo& info,
                             bool turned) {
  const std::string align = turned ? "case2" : info.align();
  const std::string key =
      str(align, " ", info.image_width(), "x", info.image_height(), " ", scan_file);
  if (images_.count(key)) return key;
  if (bytes_ >= most_bytes_) {
    warning_ = "some range images were skipped to limit the size of the file";
    return "";
  }
  if (!is_scan_file_name(scan_file)) {
    warning_ = "range images are missing, because they are made of scan files, not of recordings";
    return "";
  }
  try {
    const std::string uri = png_uri(
        reduced(scan_to_image(read_scan(scan_file), parse_align_case(align), geometry_of(info))));
    bytes_ += uri.size();
    images_.emplace(key, uri);
    return key;
  } catch (const Error& error) {
    warning_ = str("some range images are missing: ", error.what());
    return "";
  }
}

}  // namespace revisit::cli
