#include "report/range_images.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "report/base64.h"
#include "revisit/pipeline/gray_png.h"
#include "revisit/pipeline/scan_file.h"
#include "revisit/pipeline/text.h"

namespace revisit::cli {
namespace {

constexpr int kWidth = 800, kHeight = 56;  // [pixels], at most
constexpr float kLevels = 32;              // fewer grey values make smaller files

/// The mean of the returns in each block of pixels.
pipeline::RangeImage reduced(const pipeline::RangeImage& image) {
  pipeline::RangeImage small;
  small.width = std::min(image.width, kWidth);
  small.height = std::min(image.height, kHeight);
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

pipeline::ImageGeometry geometry_of(const reports::RunInfo& info) {
  pipeline::ImageGeometry g;
  g.width = info.image_width();
  g.height = info.image_height();
  g.elevation_top = info.elevation_top_deg();
  g.elevation_bottom = info.elevation_bottom_deg();
  g.max_range = info.max_range_m();
  g.closing_width = info.closing_width() * 360.0 / g.width;
  g.closing_height = info.closing_height() * (g.elevation_top - g.elevation_bottom) / g.height;
  return g;
}

}  // namespace

std::string RangeImages::add(const std::string& scan_file, int frame, const reports::RunInfo& info,
                             bool turned) {
  const std::string align = turned ? "case2" : info.align();
  char number[16];
  std::snprintf(number, sizeof number, "%06d", frame);
  const std::string name = info.sequence() + "_" + number + "_" + align;
  const std::string key =
      str(name, " ", scan_file, " ", info.image_width(), "x", info.image_height());
  if (images_.count(key)) return key;
  if (bytes_ >= most_bytes_) {
    warning_ = "some range images were left out, to keep the file small (--image-mb allows more)";
    return "";
  }
  pipeline::RangeImage image;
  try {
    image = reduced(pipeline::scan_to_image(pipeline::read_scan(scan_file),
                                            pipeline::parse_align_mode(align), geometry_of(info)));
  } catch (const InputError& error) {
    warning_ = str("some range images are missing: ", error.what());
    return "";
  }
  // Several data sets of a report may have the same sequence: the key tells their scans apart.
  const std::filesystem::path file =
      folder_ / str(name, "_", pipeline::short_name_of(key).substr(0, 8), ".png");
  pipeline::write_png(file.string(), image);
  std::ostringstream content;
  content << std::ifstream(file, std::ios::binary).rdbuf();
  const std::string uri = data_uri("image/png", content.str());
  bytes_ += uri.size();
  images_.emplace(key, uri);
  return key;
}

}  // namespace revisit::cli
