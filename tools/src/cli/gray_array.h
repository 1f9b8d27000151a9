#pragma once

#include <string>
#include <vector>

#include "revisit/proto/npy.h"

namespace revisit::cli {

/// How the channels of an array `[n][c][h][w]` differ from the first, each by a constant. Throws
/// InputError, naming `what`, when they differ by anything else.
std::vector<float> gray_offsets(const proto::NpyArray& array, const std::string& what);

/// The first channel of each image.
std::vector<float> first_channels(const proto::NpyArray& array);

}  // namespace revisit::cli
