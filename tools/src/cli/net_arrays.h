#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "revisit/engine/net.h"
#include "revisit/engine/tensor.h"
#include "revisit/proto/npy.h"

namespace revisit::cli {

/// Mean to subtract from images: an image, or one value per channel (then h = w = 1).
struct Mean {
  int64_t channels = 0, h = 1, w = 1;
  std::vector<float> values;  // [channels][h][w]
};

/// Reads a file, .npy (`[c]`, `[c][h][w]`, `[1][c][h][w]`) or .binaryproto, or numbers as in
/// `--mean 104,117,123`: one per channel, or one for all.
Mean parse_mean_option(const std::string& option, const std::string& text);

std::vector<double> channel_means(const Mean& mean);

/// Subtracts from `[n][c][h][w]` values; a mean of one channel from all channels. Crops a larger
/// mean image to its center, as Caffe's data layers do in the TEST phase. Throws UsageError if
/// channels differ or the image is smaller.
void subtract(const Mean& mean, const engine::Shape& shape, float* values);

/// Constants by which channels of `[n][c][h][w]` differ from the first. Throws InputError naming
/// `what` if they differ otherwise.
std::vector<float> channel_offsets(const proto::Blob& array, const std::string& what);

std::vector<float> first_channels(const proto::Blob& array);

/// Line 1 is the label of class 0. Skips empty lines at the end. Throws InputError.
std::vector<std::string> read_labels(const std::filesystem::path& file);

/// Outputs with `labels` values per picture. Throws UsageError naming `file` if there is none.
std::vector<std::string> classifying(const engine::Plan& plan, const std::filesystem::path& file,
                                     size_t labels);

/// Prints the five largest values of each picture. `output`: [pictures][labels].
void print_best_classes(const std::string& name, std::span<const float> output,
                        const std::vector<std::string>& labels);

/// max|found - wanted| / max|wanted|, or max|found - wanted| if `absolute`; infinity if sizes, NaNs
/// or infinities differ.
double relative_error(std::span<const float> found, std::span<const float> wanted,
                      bool absolute = false);

}  // namespace revisit::cli
