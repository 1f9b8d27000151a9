#include "revisit/weights_conversion/random_model.h"

#include <cmath>

#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/hash.h"
#include "revisit/proto/net_file.h"
#include "revisit/weights_conversion/trunks.h"

namespace revisit::models {
namespace {

namespace fs = std::filesystem;

constexpr const char* kUntrainedPrefix = "untrained_";

std::string untrained_name(const std::string& name, uint64_t seed) {
  return str(kUntrainedPrefix, name, "_seed_", seed);
}

/// Random numbers of one blob: word(i) does not depend on earlier calls.
class Stream {
 public:
  Stream(uint64_t seed, uint64_t layer, uint64_t blob)
      : key_(mixed_bits(mixed_bits(seed + kSplitmixStep) + layer * kSplitmixStep + blob)) {}

  uint64_t word(uint64_t i) const { return mixed_bits(key_ + (i + 1) * kSplitmixStep); }

  /// Gaussian number i of variance 1 (mean 12 * (2^32 - 1) / 2, units of 2^32); exact in double.
  double gaussian(uint64_t i) const {
    int64_t sum = 0;
    for (uint64_t j = 0; j < 6; ++j) {
      const uint64_t bits = word(6 * i + j);
      sum += static_cast<int64_t>(bits >> 32) + static_cast<int64_t>(bits & 0xFFFFFFFF);
    }
    constexpr int64_t kMean = 6 * ((int64_t{1} << 32) - 1);
    return std::ldexp(static_cast<double>(sum - kMean), -32);
  }

  /// Number i uniform in [-1, 1), exact in double.
  double uniform(uint64_t i) const {
    return std::ldexp(static_cast<double>(word(i) >> 12), -51) - 1;
  }

 private:
  uint64_t key_;
};

void fill_convolution(caffe::LayerParameter& layer, int64_t in_channels, const Stream& weights,
                      const Stream& biases) {
  const auto& parameters = layer.convolution_param();
  const bool square = parameters.kernel_size_size() > 0;
  const int64_t kernel_h = square ? parameters.kernel_size(0) : parameters.kernel_h();
  const int64_t kernel_w = square ? parameters.kernel_size(0) : parameters.kernel_w();
  const int64_t group_channels = in_channels / parameters.group();
  const int64_t fan_in = group_channels * kernel_h * kernel_w;
  const int64_t outputs = parameters.num_output();
  layer.clear_blobs();

  auto* weight = layer.add_blobs();  // [outputs][group_channels][kernel_h][kernel_w]
  for (const int64_t dim : {outputs, group_channels, kernel_h, kernel_w})
    weight->mutable_shape()->add_dim(dim);
  const double sigma = std::sqrt(2.0 / static_cast<double>(fan_in));
  const int64_t count = outputs * fan_in;
  weight->mutable_data()->Reserve(static_cast<int>(count));
  for (int64_t i = 0; i < count; ++i)
    weight->add_data(static_cast<float>(sigma * weights.gaussian(static_cast<uint64_t>(i))));

  auto* bias = layer.add_blobs();
  bias->mutable_shape()->add_dim(outputs);
  for (int64_t i = 0; i < outputs; ++i)
    bias->add_data(static_cast<float>(0.01 * biases.uniform(static_cast<uint64_t>(i))));
}

/// Fills a trunk, which is a chain: each convolution reads the output of the previous one.
void fill_with_random_weights(caffe::NetParameter& net, uint64_t seed) {
  int64_t channels = 0;
  for (int l = 0; l < net.layer_size(); ++l) {
    caffe::LayerParameter& layer = *net.mutable_layer(l);
    if (layer.type() == "Input") channels = layer.input_param().shape(0).dim(1);
    if (layer.type() != "Convolution") continue;
    const auto index = static_cast<uint64_t>(l);
    fill_convolution(layer, channels, {seed, index, 0}, {seed, index, 1});
    channels = layer.convolution_param().num_output();
  }
}

}  // namespace

caffe::NetParameter random_model(const std::string& trunk_name, uint64_t seed) {
  caffe::NetParameter net = trunk(trunk_name);
  net.set_name(untrained_name(trunk_name, seed));
  fill_with_random_weights(net, seed);
  return net;
}

bool is_untrained(const caffe::NetParameter& net) {
  return net.name().starts_with(kUntrainedPrefix);
}

ModelFiles write_random_model(const fs::path& folder, const std::string& trunk_name,
                              uint64_t seed) {
  return write_untrained(folder, trunk_name, seed, random_model(trunk_name, seed));
}

ModelFiles write_untrained(const fs::path& folder, const std::string& name, uint64_t seed,
                           caffe::NetParameter net) {
  net.set_name(untrained_name(name, seed));
  make_folder(folder);
  const ModelFiles files{folder / (name + "_random.prototxt"),
                         folder / (name + "_random.caffemodel")};
  proto::write_net_binary(files.weights, net);
  for (caffe::LayerParameter& layer : *net.mutable_layer()) layer.clear_blobs();
  proto::write_net_text(files.prototxt, net);
  return files;
}

}  // namespace revisit::models
