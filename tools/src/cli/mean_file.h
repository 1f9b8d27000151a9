#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "revisit/engine/tensor.h"

namespace revisit::cli {

/// Mean to subtract from images: an image, or one value per channel (then h = w = 1).
struct Mean {
  int64_t channels = 0, h = 1, w = 1;
  std::vector<float> values;  // [channels][h][w]
};

/// Reads .npy (`[c]`, `[c][h][w]`, `[1][c][h][w]`) or .binaryproto, by content. Throws InputError.
Mean read_mean(const std::filesystem::path& file);

/// Reads a file, or numbers as in `--mean 104,117,123`: one per channel, or one for all.
Mean parse_mean_option(const std::string& option, const std::string& text);

std::vector<double> channel_means(const Mean& mean);

/// Subtracts from `[n][c][h][w]` values; a mean of one channel from all channels. Crops a larger
/// mean image to its center, as Caffe's data layers do in the TEST phase. Throws UsageError if
/// channels differ or the image is smaller.
void subtract(const Mean& mean, const engine::Shape& shape, float* values);

}  // namespace revisit::cli
