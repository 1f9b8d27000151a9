#include "cli/gray_array.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

struct Planes {
  int64_t n, c, pixels;
  const float* data;

  explicit Planes(const proto::NpyArray& array)
      : n(array.shape[0]),
        c(array.shape[1]),
        pixels(array.shape[2] * array.shape[3]),
        data(array.data.data()) {}
  const float* plane(int64_t image, int64_t channel) const {
    return data + (image * c + channel) * pixels;
  }
};

}  // namespace

std::vector<float> channel_offsets(const proto::NpyArray& array, const std::string& what) {
  if (array.shape.size() != 4 || array.data.empty())
    throw InputError(what, ": --single-channel needs an array n x c x h x w");
  const Planes planes(array);
  double largest = 0;
  for (const float value : array.data) largest = std::max(largest, std::abs(double{value}));
  // Each value was rounded when its channel's constant was subtracted.
  const double rounding = 4 * std::numeric_limits<float>::epsilon() * largest;
  std::vector<float> offsets;
  for (int64_t c = 0; c < planes.c; ++c) {
    const auto difference = [&](int64_t n, int64_t i) {
      return double{planes.plane(n, c)[i]} - double{planes.plane(n, 0)[i]};
    };
    double sum = 0;
    for (int64_t n = 0; n < planes.n; ++n)
      for (int64_t i = 0; i < planes.pixels; ++i) sum += difference(n, i);
    const double offset = sum / static_cast<double>(planes.n * planes.pixels);
    for (int64_t n = 0; n < planes.n; ++n)
      for (int64_t i = 0; i < planes.pixels; ++i)
        if (!(std::abs(difference(n, i) - offset) <= rounding))
          throw InputError(what, ": --single-channel: channel ", c, " of image ", n,
                           " is not channel 0 plus a constant: they differ by ", difference(n, i),
                           " at pixel ", i, ", by ", offset, " on average");
    offsets.push_back(static_cast<float>(offset));
  }
  return offsets;
}

std::vector<float> first_channels(const proto::NpyArray& array) {
  const Planes planes(array);
  std::vector<float> pictures;
  for (int64_t n = 0; n < planes.n; ++n)
    pictures.insert(pictures.end(), planes.plane(n, 0), planes.plane(n, 0) + planes.pixels);
  return pictures;
}

}  // namespace revisit::cli
