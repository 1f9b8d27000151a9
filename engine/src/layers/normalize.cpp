#include "kernels/normalize.h"

#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// The L2 normalisation of SSD (Liu et al. 2016), with a learned scale.
class Normalize : public Layer {
 public:
  explicit Normalize(const caffe::NormalizeParameter& param) : param_(param) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 1, "inputs");
    expect_count(n_outputs, 1, "outputs");
    if (inputs[0].rank() < 2)
      throw InputError(
          str("expected an input of at least 2 axes (n x c x ...), found ", inputs[0]));
    return inputs;
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    return {param_.channel_shared() ? Shape{} : Shape{inputs[0][1]}};
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }

  std::optional<WindowHw> window(const Shape&) const override {
    return param_.across_spatial() ? std::nullopt : std::optional(WindowHw{});
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& shape = binding.inputs[0];
    const NormalizeProblem problem{shape[0],
                                   shape[1],
                                   shape.product(2, shape.rank()),
                                   param_.across_spatial(),
                                   param_.channel_shared(),
                                   param_.eps(),
                                   binding.threads};
    const float* scale = binding.weights[0].values.data();
    return {"l2-normalize", [problem, scale](const Call& call) {
              normalize(problem, call.inputs[0], scale, call.outputs[0]);
            }};
  }

 private:
  caffe::NormalizeParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_normalize(const caffe::LayerParameter& param) {
  return std::make_unique<Normalize>(param.norm_param());
}

}  // namespace revisit::engine
