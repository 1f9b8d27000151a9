#include <algorithm>

#include "layers/layers.h"

namespace revisit::engine {
namespace {

class Parameter : public Layer {
 public:
  explicit Parameter(const caffe::ParameterParameter& param)
      : shape_(std::vector<int64_t>(param.shape().dim().begin(), param.shape().dim().end())) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 0, "inputs");
    expect_count(n_outputs, 1, "outputs");
    return {shape_};
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>&) const override { return {shape_}; }

  Kernel bind(const Binding& binding) const override {
    return {"copy", [values = binding.weights[0].values.data(), elements = shape_.elements()](
                        const Call& call) { std::copy_n(values, elements, call.outputs[0]); }};
  }

 private:
  Shape shape_;
};

}  // namespace

std::unique_ptr<Layer> make_parameter(const caffe::LayerParameter& param) {
  return std::make_unique<Parameter>(param.parameter_param());
}

}  // namespace revisit::engine
