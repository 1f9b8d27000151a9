#pragma once

#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "upgrade.h"

namespace revisit::proto {

/// Converts V0 layers (2013: one flat message inside V1's `layer`) to V1 layers, and merges padding
/// layers into the convolution or pooling that follows. A net without V0 layers is unchanged. Warns
/// about parameters without meaning for the type of a layer.
void upgrade_v0(caffe::NetParameter& net, const Blame& blame, std::vector<std::string>& warnings);

}  // namespace revisit::proto
