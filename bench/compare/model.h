#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "revisit/engine/tensor.h"

/// A net as read from the files, with a number for every value; input of all engines.
namespace revisit::bench {

struct ModelLayer {
  caffe::LayerParameter param;
  std::vector<size_t> inputs, outputs;  // values: an in-place layer has an output of its own
  std::vector<engine::Shape> weight_shapes;
  std::vector<std::vector<float>> weights;  // empty when no weights file was read

  bool in_place() const {
    return param.bottom_size() > 0 && param.top_size() > 0 && param.bottom(0) == param.top(0);
  }
};

struct Model {
  std::filesystem::path prototxt, weights;
  std::vector<ModelLayer> layers;     // without the Input layer
  std::vector<engine::Shape> values;  // shapes; value 0 is the input
  std::string input_name;

  const engine::Shape& input() const { return values[0]; }
  size_t output() const { return layers.back().outputs[0]; }
  const std::string& output_name() const { return layers.back().param.top(0); }
  std::vector<int> readers() const;
};

/// Accepts nets with one input and one output. An empty `weights` reads no weights.
Model read_model(const std::filesystem::path& prototxt, const std::filesystem::path& weights);

}  // namespace revisit::bench
