#include "builder.h"

#include <google/protobuf/text_format.h>

#include <algorithm>

#include "layers/layers.h"
#include "revisit/base/error.h"
#include "revisit/proto/net_file.h"

namespace revisit::random_nets {
namespace {

using engine::Shape;

constexpr int64_t kMaxElements = 30'000, kMaxWeights = 60'000;
constexpr double kMaxWork = 8e6;  // multiply-accumulates of one pass

/// Uses each weight once per output pixel.
double work_of(const std::vector<Shape>& weights, const Shape& output) {
  if (weights.empty() || weights[0].rank() < 2) return 0;
  return static_cast<double>(weights[0].elements()) * static_cast<double>(output.elements()) /
         static_cast<double>(weights[0][0]);
}

}  // namespace

std::string Builder::fresh_name(const std::string& type) {
  return type + std::to_string(result.net.layer_size());
}

size_t Builder::add_input(const Input& input, bool hidden) {
  const std::string blob = fresh_name("Input");
  std::vector<int64_t> axes;
  for (const Size& size : input.axes) {
    int64_t product = size.factor * (size.slot ? result.sizes[0][*size.slot] : 1);
    for (const Size::Axis& axis : size.axes)
      for (const Value& value : values_)
        if (value.blob == axis.blob) product *= value.shape[axis.axis];
    axes.push_back(product);
  }
  if (Shape(axes).elements() > kMaxElements) throw Unfit();
  caffe::LayerParameter& layer = *result.net.add_layer();
  layer.set_name(blob);
  layer.set_type("Input");
  layer.add_top(blob);
  for (const int64_t size : axes) {
    if (layer.input_param().shape_size() == 0) layer.mutable_input_param()->add_shape();
    layer.mutable_input_param()->mutable_shape(0)->add_dim(size);
  }
  result.inputs[blob] = input;
  values_.push_back({blob, Shape(axes), true, false, hidden, 0, values_.size()});
  return values_.size() - 1;
}

size_t Builder::add(const std::string& type, const std::vector<size_t>& inputs,
                    const std::string& params, size_t n_outputs) {
  caffe::LayerParameter layer;
  if (!google::protobuf::TextFormat::ParseFromString(params, &layer))
    throw std::logic_error(type + ": " + params);
  layer.set_type(type);
  layer.set_name(fresh_name(type));
  std::vector<Shape> shapes;
  bool is_exact = !rounds(layer);
  for (const size_t id : inputs) {
    layer.add_bottom(values_[id].blob);
    shapes.push_back(values_[id].shape);
    is_exact &= values_[id].exact;
  }
  std::vector<Shape> outputs, weights;
  bool may_be_in_place = false, dynamic = false;
  try {
    const auto made = engine::make_layer(layer);
    outputs = made->infer(shapes, n_outputs);
    weights = made->weight_shapes(shapes);
    may_be_in_place = made->allows_in_place() && n_outputs == 1 && !inputs.empty();
    dynamic = made->dynamic_axis().has_value();
    for (const size_t id : inputs) dynamic |= values_[id].dynamic;
  } catch (const Error&) {
    throw Unfit();
  }
  for (const Shape& shape : outputs)
    if (shape.elements() > kMaxElements) throw Unfit();
  for (const Shape& shape : weights)
    if (shape.elements() > kMaxWeights) throw Unfit();
  const double work = n_outputs > 0 ? work_of(weights, outputs[0]) : 0;
  if (work_ + work > kMaxWork) throw Unfit();
  work_ += work;

  for (size_t blob = 0; blob < weights.size(); ++blob)
    add_weights(weights[blob], type, blob, &layer);
  for (const size_t id : inputs) ++values_[id].readers;
  for (size_t i = 1; i < inputs.size(); ++i)
    may_be_in_place &= values_[inputs[i]].memory != values_[inputs[0]].memory;
  if (may_be_in_place && !values_[inputs[0]].hidden && random.chance(0.4)) {
    layer.add_top(layer.bottom(0));
    *result.net.add_layer() = layer;
    Value& value = values_[inputs[0]];
    value = {value.blob, outputs[0], is_exact, dynamic, false, 0, value.memory};
    for (Value& other : values_)  // all values in the memory change
      if (other.memory == value.memory) other.exact = is_exact;
    return inputs[0];
  }
  const size_t first = values_.size();
  for (size_t port = 0; port < n_outputs; ++port)
    layer.add_top(proto::port_name(layer.name(), port));
  const bool shares = proto::shares_memory(layer);
  for (size_t port = 0; port < n_outputs; ++port)
    values_.push_back({layer.top(static_cast<int>(port)), outputs[port], is_exact, dynamic, false,
                       0, shares ? values_[inputs[0]].memory : values_.size()});
  *result.net.add_layer() = layer;
  return first;
}

/// Draws uniformly, with a scale that preserves that of activations (He et al. 2015) for summed
/// weights.
void Builder::add_weights(const Shape& shape, const std::string& type, size_t blob,
                          caffe::LayerParameter* layer) {
  double low = -1, high = 1;
  if (type == "BN") {
    low = blob == 0 || blob == 3 ? 0.5 : -1, high = blob == 3 ? 2 : 1.5;  // slope, variance
  } else if (shape.rank() > 1) {
    high = std::sqrt(6.0 / static_cast<double>(shape.product(1, shape.rank())));
    low = -high;
  } else if (type == "BatchNorm" && blob > 0) {
    low = 0.5, high = 2;  // variances, and the weight of the sums
  } else if (type == "Scale" && blob == 0) {
    low = 0.5, high = 1.5;
  } else if (type == "PReLU") {
    low = -0.5, high = 0.5;
  }
  caffe::BlobProto& weights = *layer->add_blobs();
  weights.mutable_shape();
  for (const int64_t size : shape.axes()) weights.mutable_shape()->add_dim(size);
  for (int64_t i = 0; i < shape.elements(); ++i)
    weights.add_data(static_cast<float>(random.real(low, high)));
}

size_t Builder::pick(const Condition& fits) {
  std::vector<size_t> fitting, unread;
  for (size_t id = 0; id < values_.size(); ++id) {
    const Value& value = values_[id];
    if (value.hidden || value.dynamic || !fits(value)) continue;
    fitting.push_back(id);
    if (value.readers == 0) unread.push_back(id);
  }
  if (fitting.empty()) throw Unfit();
  if (random.chance(0.4)) return fitting.back();
  if (!unread.empty() && random.chance(0.5)) return random.of(unread);
  return random.of(fitting);
}

size_t Builder::of_rank(size_t least, size_t most) {
  return pick([=](const Value& v) { return v.shape.rank() >= least && v.shape.rank() <= most; });
}

size_t Builder::same_shape(size_t like) {
  const Shape shape = values_[like].shape;
  if (random.chance(0.3)) return pick([&](const Value& v) { return v.shape == shape; });
  static const std::vector<std::string> kBranches{"TanH", "ReLU", "Power", "Split", "AbsVal"};
  const std::string& type = random.of(kBranches);
  return add(type, {like}, type == "Power" ? "power_param { scale: -0.5 shift: 0.25 }" : "");
}

}  // namespace revisit::random_nets
