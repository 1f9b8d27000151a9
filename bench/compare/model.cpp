#include "model.h"

#include <map>

#include "layers/layers.h"
#include "revisit/proto/net_file.h"

namespace revisit::bench {
namespace {

using Blobs = std::map<std::string, std::vector<std::vector<float>>>;  // by layer name

Blobs read_blobs(const std::filesystem::path& weights) {
  Blobs blobs;
  if (weights.empty()) return blobs;
  const proto::NetFile file = proto::read_net_binary(weights);
  for (const caffe::LayerParameter& layer : file.net.layer())
    for (const caffe::BlobProto& blob : layer.blobs())
      blobs[layer.name()].emplace_back(blob.data().begin(), blob.data().end());
  return blobs;
}

class Reader {
 public:
  Reader(Model* model, Blobs blobs) : model_(*model), blobs_(std::move(blobs)) {}

  void add(const caffe::LayerParameter& param) {
    if (param.type() == "Input") {
      if (!model_.values.empty()) throw InputError("expected a net with one input");
      const auto& dims = param.input_param().shape(0).dim();
      model_.input_name = param.top(0);
      define(param.top(0), engine::Shape(std::vector<int64_t>(dims.begin(), dims.end())));
      return;
    }
    ModelLayer layer{.param = param};
    std::vector<engine::Shape> shapes;
    for (const std::string& bottom : param.bottom()) {
      layer.inputs.push_back(value_of_.at(bottom));
      shapes.push_back(model_.values[layer.inputs.back()]);
    }
    const auto engine_layer = engine::make_layer(param);
    const auto n_outputs = static_cast<size_t>(param.top_size());
    const std::vector<engine::Shape> outputs = engine_layer->infer(shapes, n_outputs);
    layer.weight_shapes = engine_layer->weight_shapes(shapes);
    layer.weights = blobs_[param.name()];
    for (size_t i = 0; i < n_outputs; ++i)
      layer.outputs.push_back(define(param.top(static_cast<int>(i)), outputs[i]));
    model_.layers.push_back(std::move(layer));
  }

 private:
  size_t define(const std::string& blob, const engine::Shape& shape) {
    model_.values.push_back(shape);
    return value_of_[blob] = model_.values.size() - 1;
  }

  Model& model_;
  Blobs blobs_;
  std::map<std::string, size_t> value_of_;
};

}  // namespace

std::vector<int> Model::readers() const {
  std::vector<int> count(values.size(), 0);
  for (const ModelLayer& layer : layers)
    for (const size_t value : layer.inputs) ++count[value];
  return count;
}

Model read_model(const std::filesystem::path& prototxt, const std::filesystem::path& weights) {
  Model model{.prototxt = prototxt, .weights = weights};
  Reader reader(&model, read_blobs(weights));
  const proto::NetFile file = proto::read_net(prototxt);
  for (const caffe::LayerParameter& layer : file.net.layer()) reader.add(layer);
  return model;
}

}  // namespace revisit::bench
