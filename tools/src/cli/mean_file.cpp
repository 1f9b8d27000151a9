#include "mean_file.h"

#include <cmath>
#include <numeric>

#include "cli/options.h"
#include "revisit/base/files.h"
#include "revisit/base/text.h"
#include "revisit/proto/npy.h"
#include "revisit/proto/weights_file.h"

namespace revisit::cli {
Mean read_mean(const std::filesystem::path& file) {
  constexpr std::string_view kNpyMagic = "\x93NUMPY";
  Mean mean;
  std::vector<int64_t> shape;
  if (read_head(file, kNpyMagic.size()) == kNpyMagic) {
    proto::NpyArray array = proto::read_npy(file);
    shape = std::move(array.shape);
    mean.values = std::move(array.data);
  } else {
    proto::Blob blob = proto::read_binaryproto(file);
    shape = std::move(blob.shape);
    mean.values = std::move(blob.data);
  }
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

}  // namespace revisit::cli
