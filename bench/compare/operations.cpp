#include "operations.h"

#include <cmath>

namespace revisit::bench {
namespace {

class Folder {
 public:
  explicit Folder(const Model& model)
      : model_(model), readers_(model.readers()), held_by_(model.values.size()) {
    for (size_t i = 0; i < held_by_.size(); ++i) held_by_[i] = i;
  }

  std::vector<Operation> run() {
    for (const ModelLayer& layer : model_.layers) {
      const std::string& type = layer.param.type();
      if (type == "Dropout")
        held_by_[layer.outputs[0]] = held_by_[layer.inputs[0]];
      else if (!(type == "BatchNorm" && take_batch_norm(layer)) &&
               !(type == "Scale" && take_scale(layer)) && !(type == "ReLU" && take_relu(layer)) &&
               !(type == "Eltwise" && take_sum(layer)))
        add(layer);
    }
    return std::move(operations_);
  }

 private:
  void add(const ModelLayer& layer) {
    Operation operation{.layer = &layer, .inputs = {}, .output = layer.outputs[0]};
    for (const size_t value : layer.inputs) operation.inputs.push_back(held_by_[value]);
    const std::string& type = layer.param.type();
    if (type == "Convolution" || type == "InnerProduct") {
      operation.weights = layer.weights[0];
      operation.bias = layer.weights.size() > 1
                           ? layer.weights[1]
                           : std::vector<float>(layer.weight_shapes[0][0], 0.0F);
    }
    operations_.push_back(std::move(operation));
  }

  /// Producer of the value, if one layer reads it and it has no ReLU yet.
  Operation* open_maker(size_t value) {
    if (readers_[value] != 1) return nullptr;
    for (Operation& operation : operations_)
      if (operation.output == held_by_[value]) return operation.relu ? nullptr : &operation;
    return nullptr;
  }

  Operation* open_convolution(size_t value) {
    Operation* const maker = open_maker(value);
    return maker && maker->layer->param.type() == "Convolution" && !maker->addend ? maker : nullptr;
  }

  void absorb(Operation* into, const ModelLayer& layer) { into->output = layer.outputs[0]; }

  bool take_affine(const ModelLayer& layer, const std::vector<double>& scale,
                   const std::vector<double>& shift) {
    Operation* const convolution = open_convolution(layer.inputs[0]);
    if (!convolution) return false;
    const size_t depth = convolution->weights.size() / scale.size();
    for (size_t c = 0; c < scale.size(); ++c) {
      for (size_t i = c * depth; i < (c + 1) * depth; ++i)
        convolution->weights[i] = static_cast<float>(convolution->weights[i] * scale[c]);
      convolution->bias[c] = static_cast<float>(convolution->bias[c] * scale[c] + shift[c]);
    }
    absorb(convolution, layer);
    return true;
  }

  bool take_batch_norm(const ModelLayer& layer) {
    const double weight = layer.weights[2][0], factor = weight == 0 ? 0 : 1 / weight;
    std::vector<double> scale, shift;
    for (size_t c = 0; c < layer.weights[0].size(); ++c) {
      scale.push_back(
          1 / std::sqrt(factor * layer.weights[1][c] + layer.param.batch_norm_param().eps()));
      shift.push_back(-factor * layer.weights[0][c] * scale[c]);
    }
    return take_affine(layer, scale, shift);
  }

  bool take_scale(const ModelLayer& layer) {
    std::vector<double> scale(layer.weights[0].begin(), layer.weights[0].end());
    std::vector<double> shift(scale.size(), 0);
    if (layer.weights.size() > 1) shift.assign(layer.weights[1].begin(), layer.weights[1].end());
    return take_affine(layer, scale, shift);
  }

  bool take_relu(const ModelLayer& layer) {
    Operation* const maker = open_maker(layer.inputs[0]);
    if (!maker) return false;
    const std::string& type = maker->layer->param.type();
    if (type != "Convolution" && type != "InnerProduct") return false;
    maker->relu = layer.param.relu_param().negative_slope();
    absorb(maker, layer);
    return true;
  }

  /// Overwrites the first input, a shortcut that no later layer reads.
  bool take_sum(const ModelLayer& layer) {
    if (layer.inputs.size() != 2 || layer.param.eltwise_param().coeff_size() > 0 ||
        layer.param.eltwise_param().operation() != caffe::EltwiseParameter::SUM)
      return false;
    for (const size_t sums : {size_t{1}, size_t{0}}) {
      const size_t addend = layer.inputs[1 - sums];
      Operation* const convolution = open_convolution(layer.inputs[sums]);
      if (!convolution || convolution != &operations_.back() || !is_last_reader(layer, addend))
        continue;
      convolution->addend = held_by_[addend];
      absorb(convolution, layer);
      return true;
    }
    return false;
  }

  bool is_last_reader(const ModelLayer& layer, size_t value) const {
    if (held_by_[value] == 0) return false;
    for (const ModelLayer* later = &layer + 1; later <= &model_.layers.back(); ++later)
      for (const size_t input : later->inputs)
        if (input == value) return false;
    return true;
  }

  const Model& model_;
  std::vector<int> readers_;
  std::vector<size_t> held_by_;  // by value: the value that holds it
  std::vector<Operation> operations_;
};

/// [c_out][c_in][taps] to [c_out][taps]
void sum_over_channels(Operation* convolution) {
  const engine::Shape& shape = convolution->layer->weight_shapes[0];
  const int64_t taps = shape.product(2, shape.rank());
  std::vector<float> sums;
  for (int64_t o = 0; o < shape[0]; ++o)
    for (int64_t i = 0; i < taps; ++i) {
      double sum = 0;
      for (int64_t c = 0; c < shape[1]; ++c)
        sum += convolution->weights[(o * shape[1] + c) * taps + i];
      sums.push_back(static_cast<float>(sum));
    }
  convolution->weights = std::move(sums);
}

}  // namespace

std::vector<Operation> fold(const Model& model, bool gray) {
  std::vector<Operation> operations = Folder(model).run();
  if (gray) sum_over_channels(&operations[0]);
  return operations;
}

}  // namespace revisit::bench
