#pragma once

#include <string>
#include <vector>

#include "caffe_schema.pb.h"

namespace revisit::proto {

/// Converts ProposalLayer of Faster R-CNN, a layer of type Python, to a Proposal layer if all of
/// its `param_str` is known. Settings of its other files (config.py, generate_anchors.py) are those
/// of rbgirshick/py-faster-rcnn; a warning lists them. The layer keeps its `python_param`, which
/// tells the engine to drop small regions instead of setting their score to 0.
void replace_python_proposals(caffe::NetParameter& net, std::vector<std::string>& warnings);

}  // namespace revisit::proto
