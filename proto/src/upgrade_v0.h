#pragma once

#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "upgrade.h"

namespace revisit::proto {

/// Turns V0 layers (2013: one flat message inside V1's `layer`) into V1 layers, and folds padding
/// layers into the convolution or pooling that follows. A net without V0 layers is left alone.
/// Parameters that mean nothing for a layer's type are warned about.
void upgrade_v0(caffe::NetParameter& net, const Blame& blame, std::vector<std::string>& warnings);

}  // namespace revisit::proto
