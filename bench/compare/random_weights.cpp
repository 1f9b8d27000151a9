// Writes random weights for any prototxt; activations keep their magnitude over depth:
//   revisit_random_weights net.prototxt seed net.caffemodel
#include <cmath>
#include <cstdio>
#include <random>

#include "model.h"
#include "revisit/proto/net_file.h"

namespace {

using namespace revisit;

/// Uniform in [low, high).
std::pair<double, double> range_of(const bench::ModelLayer& layer, size_t index) {
  constexpr double kPixelValues = 64;  // about the size of the input's
  const std::string& type = layer.param.type();
  const engine::Shape& shape = layer.weight_shapes[index];
  if (type == "BatchNorm" && index == 1) return {0.5, 2};  // variances
  if (type == "BatchNorm" && index == 2) return {1, 1};    // divisor of both
  if (type == "Scale" && index == 0) return {0.5, 1};
  if (shape.rank() < 2) return {-0.1, 0.1};
  // He et al. 2015, for layers followed by ReLU.
  double limit = std::sqrt(6.0 / static_cast<double>(shape.product(1, shape.rank())));
  if (layer.inputs[0] == 0) limit /= kPixelValues;
  return {-limit, limit};
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 4) {
    std::fprintf(stderr, "usage: %s PROTOTXT SEED CAFFEMODEL\n", argv[0]);
    return 2;
  }
  std::mt19937_64 random(std::stoull(argv[2]));
  caffe::NetParameter net;
  for (const bench::ModelLayer& layer : bench::read_model(argv[1], "").layers) {
    caffe::LayerParameter& out = *net.add_layer();
    out.set_name(layer.param.name());
    out.set_type(layer.param.type());
    for (size_t i = 0; i < layer.weight_shapes.size(); ++i) {
      caffe::BlobProto& blob = *out.add_blobs();
      for (const int64_t size : layer.weight_shapes[i].axes()) blob.mutable_shape()->add_dim(size);
      const auto [low, high] = range_of(layer, i);
      for (int64_t k = 0; k < layer.weight_shapes[i].elements(); ++k) {
        const double unit = static_cast<double>(random() >> 11) * 0x1.0p-53;  // [0, 1)
        blob.add_data(static_cast<float>(low + (high - low) * unit));
      }
    }
  }
  proto::write_net_binary(argv[3], net);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
