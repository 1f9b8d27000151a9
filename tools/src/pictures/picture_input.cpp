#include <algorithm>

#include "pictures/picture.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

struct Between {
  int64_t first = 0, second = 0;
  float weight = 0;  // of the second
};

/// Positions of the centers of `to` pixels among `from` pixels, as in OpenCV's resize().
std::vector<Between> stretched(int64_t from, int64_t to) {
  std::vector<Between> places;
  const double scale = static_cast<double>(from) / static_cast<double>(to);
  for (int64_t i = 0; i < to; ++i) {
    const double at = std::clamp((static_cast<double>(i) + 0.5) * scale - 0.5, 0.0,
                                 static_cast<double>(from - 1));
    const auto first = static_cast<int64_t>(at);
    places.push_back({first, std::min(first + 1, from - 1),
                      static_cast<float>(at - static_cast<double>(first))});
  }
  return places;
}

std::vector<float> plane_of(const Picture& picture, int64_t channel) {
  std::vector<float> plane;
  for (size_t i = channel; i < picture.pixels.size(); i += picture.channels)
    plane.push_back(picture.pixels[i]);
  return plane;
}

void stretch(const std::vector<float>& plane, int64_t width, const std::vector<Between>& rows,
             const std::vector<Between>& columns, std::vector<float>* out) {
  for (const Between& y : rows)
    for (const Between& x : columns) {
      const auto across = [&](int64_t row) {
        const float* const values = &plane[static_cast<size_t>(row * width)];
        return values[x.first] + x.weight * (values[x.second] - values[x.first]);
      };
      const float above = across(y.first);
      out->push_back(above + y.weight * (across(y.second) - above));
    }
}

}  // namespace

proto::Blob picture_input(const std::vector<std::filesystem::path>& files, const std::string& blob,
                          const engine::Shape& input, bool rgb) {
  if (input.rank() != 4 || (input[1] != 3 && input[1] != 1))
    throw UsageError("--image: the input '", blob, "' is ", input,
                     " (expected n x 3 x h x w, or n x 1 x h x w for gray)");
  const auto channels = static_cast<int>(input[1]);
  proto::Blob array;
  array.shape = input.with(0, static_cast<int64_t>(files.size())).axes();
  for (const std::filesystem::path& file : files) {
    const Picture picture = read_picture(file, channels);
    const auto rows = stretched(picture.height, input[2]);
    const auto columns = stretched(picture.width, input[3]);
    for (int c = 0; c < channels; ++c)
      stretch(plane_of(picture, rgb ? channels - 1 - c : c), picture.width, rows, columns,
              &array.data);
  }
  return array;
}

}  // namespace revisit::cli
