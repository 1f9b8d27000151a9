#pragma once

#include <string>
#include <vector>

namespace revisit::caffe {
class NetParameter;
}

namespace revisit::models {

/// Names that trunk() accepts. Layers have the original names, so that the original .caffemodel
/// files match.
const std::vector<std::string>& trunk_names();

/// Returns a network from `data` [1][3][h][w] to `pool5`, in Caffe's current format and without
/// weights. `h` and `w` are those of the original; larger inputs work, too.
///
/// - "alexnet": Krizhevsky et al. 2012 as trained by BVLC (normalization before pooling)
/// - "caffenet": AlexNet with pooling before normalization
/// - "vgg_cnn_s": Chatfield et al. 2014, the slow network
/// - "places_cnds8": Wang et al. 2015, eight convolutions
/// - "ring64", "ring16": a convolution and a max pooling with output "pool1", for range images
///   [1][1][beams][1280] of 64 or 16 beams
///
/// Throws UsageError for other names.
caffe::NetParameter trunk(const std::string& name);

}  // namespace revisit::models
