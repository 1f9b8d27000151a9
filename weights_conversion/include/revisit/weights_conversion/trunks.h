#pragma once

#include <string>
#include <vector>

namespace revisit::caffe {
class NetParameter;
}

namespace revisit::models {

/// The names `trunk()` knows: the convolutional part (input to pool5) of the paper's three networks
/// and of CaffeNet, whose originals name their layers the same, so that their .caffemodel files
/// fit; and the single convolutions that rings are taken from where no trained network is at hand.
const std::vector<std::string>& trunk_names();

/// Our own description, in Caffe's current form and without weights, of the layers from `data`
/// [1][3][h][w] to `pool5`. `h` and `w` are the originals'; any larger input works as well.
///
/// - "alexnet": Krizhevsky et al. 2012 as BVLC trained it (normalise, then pool)
/// - "caffenet": the same, pooling before normalising
/// - "vgg_cnn_s": Chatfield et al. 2014, the slow network
/// - "places_cnds8": Wang et al. 2015, eight convolutions
/// - "ring64", "ring16": a convolution and a max pooling, for range images [1][1][64 or 16][1280]
///   of as many beams; their output is "pool1"
///
/// Throws UsageError for another name.
caffe::NetParameter trunk(const std::string& name);

}  // namespace revisit::models
