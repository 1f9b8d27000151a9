#pragma once

#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "upgrade.h"

namespace revisit::proto {

/// The type of a Crop of FCN's fork (V1's CROP), which finds its offset: the pixels of both inputs
/// lie over each other.
constexpr const char* kAligningCrop = "CROP";

/// Gives crops of that type, where it can, the offset and the type of Caffe's Crop. Of a Crop
/// without an offset it is said where the fork would have had one.
void find_crop_offsets(caffe::NetParameter& net, const Blame& blame,
                       std::vector<std::string>& warnings);

}  // namespace revisit::proto
