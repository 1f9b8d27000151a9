#pragma once

#include <string>
#include <vector>

namespace revisit::caffe {
class NetParameter;
}

namespace revisit::models {

/// The names `trunk()` knows: the convolutional part (input to pool5) of the paper's three networks
/// and of CaffeNet. The originals name their layers the same, so their .caffemodel files fit.
const std::vector<std::string>& trunk_names();

/// Our own description, in Caffe's current form and without weights, of the layers from `data`
/// [1][3][h][w] to `pool5`. `h` and `w` are the originals'; any larger input works as well.
///
/// - "alexnet": Krizhevsky et al. 2012 as BVLC trained it (normalise, then pool)
/// - "caffenet": the same, pooling before normalising
/// - "vgg_cnn_s": Chatfield et al. 2014, the slow network
/// - "places_cnds8": Wang et al. 2015, eight convolutions
///
/// Throws UsageError for another name.
caffe::NetParameter trunk(const std::string& name);

}  // namespace revisit::models
