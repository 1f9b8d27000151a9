#include "net_arrays.h"

#include <algorithm>
#include <cmath>
#include <iostream>
#include <limits>
#include <numeric>
#include <sstream>

#include "cli/options.h"
#include "cli/terminal.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/text.h"
#include "revisit/proto/npy.h"
#include "revisit/proto/weights_file.h"

namespace revisit::cli {
namespace {

Mean read_mean(const std::filesystem::path& file) {
  constexpr std::string_view kNpyMagic = "\x93NUMPY";
  const bool is_npy = read_head(file, kNpyMagic.size()) == kNpyMagic;
  proto::Blob array = is_npy ? proto::read_npy(file) : proto::read_binaryproto(file);
  std::vector<int64_t>& shape = array.shape;
  Mean mean;
  mean.values = std::move(array.data);
  const auto bad = [&](const std::string& what) { return InputError(file.string(), ": ", what); };
  const engine::Shape found(shape);
  if (shape.size() == 4 && shape[0] == 1) shape.erase(shape.begin());
  if ((shape.size() != 1 && shape.size() != 3) || mean.values.empty())
    throw bad(str("a mean has the shape channels or channels x height x width, found ", found));
  for (const float value : mean.values)
    if (!std::isfinite(value)) throw bad("the mean is not finite");
  mean.channels = shape[0];
  if (shape.size() == 3) mean.h = shape[1], mean.w = shape[2];
  return mean;
}

struct Planes {
  int64_t n, c, pixels;
  const float* data;

  explicit Planes(const proto::Blob& array)
      : n(array.shape[0]),
        c(array.shape[1]),
        pixels(array.shape[2] * array.shape[3]),
        data(array.data.data()) {}
  const float* plane(int64_t image, int64_t channel) const {
    return data + (image * c + channel) * pixels;
  }
};

constexpr size_t kMaxShown = 5;

int64_t values_per_picture(const engine::Shape& output) {
  return output.rank() < 2 ? output.elements() : output.product(1, output.rank());
}

}  // namespace

Mean parse_mean_option(const std::string& option, const std::string& text) {
  const bool are_numbers = text.find_first_not_of("0123456789.,+-eE") == std::string::npos;
  if (std::error_code none; !are_numbers || std::filesystem::exists(text, none))
    return read_mean(text);
  Mean mean;
  std::vector<std::string> fields = comma_separated(text);
  if (text.empty() || text.back() == ',') fields.emplace_back();
  for (const std::string& field : fields) {
    mean.values.push_back(static_cast<float>(parse_value<double>(option, field)));
    if (!std::isfinite(mean.values.back()))
      throw UsageError(option, ": ", field, " is out of range");
  }
  mean.channels = static_cast<int64_t>(mean.values.size());
  return mean;
}

std::vector<double> channel_means(const Mean& mean) {
  const int64_t pixels = mean.h * mean.w;
  std::vector<double> means;
  for (int64_t c = 0; c < mean.channels; ++c) {
    const auto plane = mean.values.begin() + c * pixels;
    means.push_back(std::accumulate(plane, plane + pixels, 0.0) / static_cast<double>(pixels));
  }
  return means;
}

void subtract(const Mean& mean, const engine::Shape& shape, float* values) {
  if (shape.rank() != 4 || (mean.channels != 1 && shape[1] != mean.channels))
    throw UsageError("--mean: the mean has ", mean.channels, " channels, the input is ", shape);
  const int64_t h = shape[2], w = shape[3];
  const bool is_image = mean.h * mean.w > 1;
  if (is_image && (mean.h < h || mean.w < w))
    throw UsageError("--mean: the mean image is ", mean.h, " x ", mean.w,
                     ", smaller than the input, ", h, " x ", w,
                     "; give the means of its channels: ", joined(channel_means(mean), ","));
  const int64_t top = (mean.h - h) / 2, left = (mean.w - w) / 2;
  for (int64_t plane = 0; plane < shape[0] * shape[1]; ++plane) {
    const float* const from = mean.values.data() + plane % mean.channels * mean.h * mean.w;
    for (int64_t y = 0; y < h; ++y)
      for (int64_t x = 0; x < w; ++x)
        values[(plane * h + y) * w + x] -= is_image ? from[(y + top) * mean.w + x + left] : from[0];
  }
}

std::vector<float> channel_offsets(const proto::Blob& array, const std::string& what) {
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

std::vector<float> first_channels(const proto::Blob& array) {
  const Planes planes(array);
  std::vector<float> pictures;
  for (int64_t n = 0; n < planes.n; ++n)
    pictures.insert(pictures.end(), planes.plane(n, 0), planes.plane(n, 0) + planes.pixels);
  return pictures;
}

std::vector<std::string> read_labels(const std::filesystem::path& file) {
  std::vector<std::string> labels;
  std::istringstream lines(read_content(file));
  for (std::string line; std::getline(lines, line);) {
    if (line.ends_with('\r')) line.pop_back();
    labels.push_back(line);
  }
  while (!labels.empty() && labels.back().empty()) labels.pop_back();
  if (labels.empty()) throw InputError(file.string(), ": expected a label per line, found none");
  return labels;
}

std::vector<std::string> classifying(const engine::Plan& plan, const std::filesystem::path& file,
                                     size_t labels) {
  std::vector<std::string> names;
  for (const engine::Port& port : plan.outputs())
    if (values_per_picture(port.shape) == static_cast<int64_t>(labels)) names.push_back(port.name);
  if (names.empty())
    throw UsageError("--labels: ", file.string(), " has ", labels, " lines, but of each picture ",
                     joined(plan.outputs(), ", ", [](const engine::Port& port) {
                       return str("the output '", port.name, "' has ",
                                  values_per_picture(port.shape), " numbers");
                     }));
  return names;
}

void print_best_classes(const std::string& name, std::span<const float> output,
                        const std::vector<std::string>& labels) {
  Table table({"output", "picture", "value", "class", "label"});
  const size_t pictures = output.size() / labels.size();
  for (size_t picture = 0; picture < pictures; ++picture) {
    const float* const values = output.data() + picture * labels.size();
    std::vector<size_t> order(labels.size());
    std::iota(order.begin(), order.end(), size_t{0});
    const auto value = [values](size_t i) {
      return std::isnan(values[i]) ? -std::numeric_limits<float>::infinity() : values[i];
    };
    std::ranges::stable_sort(order, std::ranges::greater{}, value);
    for (size_t i = 0; i < std::min(kMaxShown, order.size()); ++i)
      table.row(
          {name, str(picture + 1), number(values[order[i]], 4), str(order[i]), labels[order[i]]});
  }
  table.print(std::cout);
}

double relative_error(std::span<const float> found, std::span<const float> wanted, bool absolute) {
  if (found.size() != wanted.size()) return INFINITY;
  double worst = 0, largest = 0;
  for (size_t i = 0; i < found.size(); ++i) {
    if (std::isfinite(found[i]) && std::isfinite(wanted[i])) {
      worst = std::max(worst, std::abs(static_cast<double>(found[i]) - wanted[i]));
      largest = std::max(largest, std::abs(static_cast<double>(wanted[i])));
    } else if (!(std::isnan(found[i]) && std::isnan(wanted[i])) && found[i] != wanted[i]) {
      return INFINITY;
    }
  }
  return largest > 0 && !absolute ? worst / largest : worst;
}

}  // namespace revisit::cli
