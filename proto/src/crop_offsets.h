#pragma once

#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "upgrade.h"

namespace revisit::proto {

/// Type of the Crop in FCN's fork (V1's CROP), which computes its offset by aligning the pixels of
/// both inputs.
constexpr const char* kAligningCrop = "CROP";

/// Converts crops of that type to Caffe's Crop with the computed offset, where possible. Warns
/// about each Crop without an offset for which the fork would compute a nonzero one.
void find_crop_offsets(caffe::NetParameter& net, const Blame& blame,
                       std::vector<std::string>& warnings);

}  // namespace revisit::proto
