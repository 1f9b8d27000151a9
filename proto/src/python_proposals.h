#pragma once

#include <string>
#include <vector>

#include "caffe_schema.pb.h"

namespace revisit::proto {

/// Makes Proposal layers of Faster R-CNN's ProposalLayer, a layer of the type Python, where all of
/// its `param_str` is known. What its other files say (config.py, generate_anchors.py) is taken
/// from rbgirshick/py-faster-rcnn, which a warning lists. They keep their `python_param`: it says
/// that small regions are dropped, and not given the score 0.
void replace_python_proposals(caffe::NetParameter& net, std::vector<std::string>& warnings);

}  // namespace revisit::proto
