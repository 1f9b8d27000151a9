#pragma once

#include <string>
#include <vector>

#include "revisit/proto/npy.h"

namespace revisit::cli {

/// Constants by which channels of `[n][c][h][w]` differ from the first. Throws InputError naming
/// `what` if they differ otherwise.
std::vector<float> channel_offsets(const proto::NpyArray& array, const std::string& what);

std::vector<float> first_channels(const proto::NpyArray& array);

}  // namespace revisit::cli
