#include "random_net.h"

#include <cmath>
#include <set>
#include <stdexcept>

#include "builder.h"
#include "layers/layers.h"
#include "revisit/base/error.h"
#include "revisit/proto/net_file.h"
#include "testing.h"

namespace revisit::random_nets {
namespace {

using engine::Shape;

int64_t value_of(const Size& size, const std::vector<int64_t>& sizes,
                 const std::map<std::string, Shape>& blobs) {
  int64_t product = size.factor * (size.slot ? sizes[*size.slot] : 1);
  for (const Size::Axis& axis : size.axes) product *= blobs.at(axis.blob)[axis.axis];
  return product;
}

Input first_input(Builder& b, bool gray) {
  static const std::vector<int64_t> kChannels{1, 2, 3, 4, 5, 8, 12, 16, 17, 24, 32, 48};
  static const std::vector<int64_t> kSpatial{4, 4, 4, 4, 4, 4, 2, 3, 5};
  const int64_t rank = gray ? 4 : b.random.of(kSpatial);
  Input input{{Size{1, 0}, Size{gray ? b.random.between(1, 4) : b.random.of(kChannels)}}};
  for (size_t slot = 1; static_cast<int64_t>(slot) + 1 < rank; ++slot)
    input.axes.push_back({1, slot});
  return input;
}

std::vector<int64_t> random_sizes(Random& random) {
  std::vector<int64_t> sizes{random.chance(0.6) ? 1 : random.between(2, 3)};
  static const std::vector<int64_t> kEven{4, 8, 8, 16};  // buffers then end where a cache line does
  const bool large = random.chance(0.2), even = random.chance(0.3);
  for (int slot = 1; slot <= 3; ++slot)
    sizes.push_back(even ? random.of(kEven) : random.between(1, large ? 40 : 16));
  return sizes;
}

void add_random_layer(Builder& b) {
  const std::vector<LayerMaker>& makers = layer_makers();
  int64_t total = 0;
  for (const LayerMaker& maker : makers) total += maker.weight;
  int64_t at = b.random.between(0, total - 1);
  for (const LayerMaker& maker : makers)
    if ((at -= maker.weight) < 0) return maker.make(b, maker.type);
}

void begin_gray(Builder& b, size_t input) {
  const int64_t n = b.random.between(1, 2);
  for (int64_t i = 0, tries = 0; i < n; ++tries) {
    if (tries == 100) throw Unfit();
    try {
      static const std::vector<int64_t> kOutputs{1, 3, 8, 16, 16, 20, 32};
      b.add("Convolution", {input},
            str("convolution_param { num_output: ", b.random.of(kOutputs), " ",
                random_windows(b.random, 2), " }"));
      ++i;
    } catch (const Unfit&) {
    }
  }
  const auto channels = static_cast<size_t>(b.shape(input)[1]);
  while (b.result.channel_offsets.size() < channels)
    b.result.channel_offsets.push_back(static_cast<float>(b.random.between(-16, 16)) / 16);
}

/// Includes the input's readers for a single-channel net.
Builder begin(uint64_t seed) {
  Random seeds(seed);
  while (true) {
    Builder b(seeds.next());
    b.result.net.set_name(str("random ", seed));
    b.result.sizes.push_back(random_sizes(b.random));
    const bool gray = b.random.chance(0.2);
    b.takes_inputs = !gray;
    try {
      const size_t input = b.add_input(first_input(b, gray), gray);
      if (gray) begin_gray(b, input);
      return b;
    } catch (const Unfit&) {
    }
  }
}

engine::Net load_structure(const RandomNet& net) {
  const test::TempDir folder;
  proto::write_net_text(folder / "net.prototxt", net.net);
  return engine::Net::load_without_weights(folder / "net.prototxt",
                                           {.end = net.end, .graft = net.graft});
}

/// A grafted layer has a different input than in the full net: only a plan can tell if it fits.
void plan_at(const RandomNet& net, const std::map<std::string, Shape>& shapes) {
  const engine::Net loaded = load_structure(net);
  std::map<std::string, Shape> needed;
  for (const engine::Port& port : loaded.inputs()) needed[port.name] = shapes.at(port.name);
  loaded.plan(needed);
}

/// All layers accept the result; it equals the current sizes if no others are found.
std::vector<int64_t> other_sizes(const RandomNet& net, Random& random) {
  for (int attempt = 0; attempt < 40; ++attempt) {
    std::vector<int64_t> sizes = net.sizes[0];
    const bool batch_only = attempt >= 30;
    for (size_t slot = 0; slot < (batch_only ? 1 : sizes.size()); ++slot)
      if (random.chance(0.5))
        sizes[slot] = random.between(1, slot == 0            ? 3
                                        : random.chance(0.4) ? 4
                                                             : 2 * net.sizes[0][slot]);
    try {
      if (sizes == net.sizes[0]) continue;
      const InputShapes all = input_shapes(net, sizes);
      if (!net.graft.empty()) plan_at(net, all.shapes);
      return sizes;
    } catch (const InputError&) {
    }
  }
  return net.sizes[0];
}

void truncate(RandomNet& net, Random& random) {
  const auto some_layer = [&]() -> const caffe::LayerParameter& {
    return net.net.layer(static_cast<int>(random.between(0, net.net.layer_size() - 1)));
  };
  for (int attempt = 0; attempt < 5; ++attempt) {
    net.end = some_layer().name();
    // The weights of a layer belong to its own name.
    if (const caffe::LayerParameter& graft = some_layer(); graft.blobs_size() == 0)
      net.graft = graft.name();
    try {
      load_structure(net).plan();
      return;
    } catch (const Error&) {
      net.end = net.graft = "";
    }
  }
}

}  // namespace

RandomNet make_random_net(uint64_t seed) {
  Builder b = begin(seed);
  const int64_t layers = b.random.between(2, 14);
  for (int tries = 0; tries < 300 && b.result.net.layer_size() < layers + 1; ++tries) {
    try {
      add_random_layer(b);
    } catch (const Unfit&) {
    }
  }
  RandomNet net = std::move(b.result);
  net.seed = seed;
  try {
    load_structure(net).plan();
  } catch (const Error& error) {
    throw std::logic_error(str("seed ", seed, ": the generator made what the engine refuses: ",
                               error.what(), "\n", text_of(net)));
  }
  if (b.random.chance(0.2)) truncate(net, b.random);
  net.sizes.push_back(other_sizes(net, b.random));
  return net;
}

InputShapes input_shapes(const RandomNet& net, const std::vector<int64_t>& sizes) {
  InputShapes result;
  std::map<std::string, Shape> blobs;
  for (const caffe::LayerParameter& layer : net.net.layer()) {
    if (layer.type() == "Input") {
      const std::string& blob = layer.top(0);
      const Input& input = net.inputs.at(blob);
      std::vector<int64_t> axes;
      for (const Size& size : input.axes) axes.push_back(value_of(size, sizes, blobs));
      blobs[blob] = result.shapes[blob] = Shape(std::move(axes));
      result.bounds[blob] = value_of(input.bound, sizes, blobs);
      continue;
    }
    std::vector<Shape> inputs;
    for (const std::string& bottom : layer.bottom()) inputs.push_back(blobs.at(bottom));
    const auto made = engine::make_layer(layer);
    const std::vector<Shape> outputs = made->infer(inputs, static_cast<size_t>(layer.top_size()));
    const std::vector<Shape> weights = made->weight_shapes(inputs);
    for (size_t i = 0; i < weights.size(); ++i)
      if (const auto& dims = layer.blobs(static_cast<int>(i)).shape().dim();
          !std::equal(dims.begin(), dims.end(), weights[i].axes().begin(), weights[i].axes().end()))
        throw InputError(str(layer.name(), " would need other weights"));
    for (size_t port = 0; port < outputs.size(); ++port)
      blobs[layer.top(static_cast<int>(port))] = outputs[port];
  }
  return result;
}

bool rounds(const caffe::LayerParameter& layer) {
  static const std::set<std::string> kExact{"AbsVal",
                                            "Accuracy",
                                            "ArgMax",
                                            "BatchReindex",
                                            "Clip",
                                            "Concat",
                                            "Crop",
                                            "CropCenter",
                                            "DetectionOutput",
                                            "DepthToSpace",
                                            "Dropout",
                                            "DummyData",
                                            "Filter",
                                            "Flatten",
                                            "Flip",
                                            "Im2col",
                                            "Input",
                                            "Parameter",
                                            "Permute",
                                            "PReLU",
                                            "PriorBox",
                                            "Proposal",
                                            "ReLU",
                                            "ReLU6",
                                            "Reorg",
                                            "ContinuationIndicator",
                                            "CTCGreedyDecoder",
                                            "FrcnnProposal",
                                            "Reshape",
                                            "Reverse",
                                            "ROIPooling",
                                            "ShuffleChannel",
                                            "Silence",
                                            "Slice",
                                            "Split",
                                            "Threshold",
                                            "Tile",
                                            "Transpose",
                                            "Upsample"};
  if (layer.type() == "Pooling")
    return layer.pooling_param().pool() != caffe::PoolingParameter::MAX;
  if (layer.type() == "SPP") return layer.spp_param().pool() != caffe::SPPParameter::MAX;
  if (layer.type() == "Eltwise")
    return layer.eltwise_param().operation() != caffe::EltwiseParameter::MAX;
  return !kExact.contains(layer.type());
}

double mean_gain(const caffe::LayerParameter& layer) {
  if (layer.type() == "MVN")
    return layer.mvn_param().normalize_variance() ? 1 / double{layer.mvn_param().eps()} : 1;
  if (const auto& param = layer.batch_norm_param();
      layer.type() == "BatchNorm" && param.has_use_global_stats() && !param.use_global_stats())
    return 1 / std::sqrt(param.eps());
  if (layer.type() == "BN" && layer.bn_param().bn_mode() == caffe::BNParameter::LEARN)
    return 1 / std::sqrt(1e-9);  // engine/src/layers/batch_norm.cpp
  return 0;
}

std::string text_of(const RandomNet& net) {
  caffe::NetParameter description = net.net;
  for (caffe::LayerParameter& layer : *description.mutable_layer()) layer.clear_blobs();
  return proto::net_text(description);
}

void write(const RandomNet& net, const std::filesystem::path& folder) {
  test::write_file(folder / "net.prototxt", text_of(net));
  proto::write_net_binary(folder / "net.caffemodel", net.net);
}

}  // namespace revisit::random_nets
