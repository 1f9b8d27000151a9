#pragma once

#include "caffe_schema.pb.h"

namespace revisit::proto {

/// Drops the layers that the TEST phase leaves out, by their include and exclude rules against
/// `net.state()`. Throws InputError for a layer that has both.
void keep_test_phase(caffe::NetParameter& net);

}  // namespace revisit::proto
