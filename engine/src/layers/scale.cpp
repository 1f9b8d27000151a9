#include "layers/broadcast.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// input * scale + bias, broadcast. The scale is learned or the second input; a bias is learned.
class Scale : public Layer {
 public:
  explicit Scale(const caffe::ScaleParameter& param) : param_(param) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    if (inputs.empty() || inputs.size() > 2)
      throw InputError(str("expected 1 or 2 inputs, found ", inputs.size()));
    expect_count(n_outputs, 1, "outputs");
    runs(inputs);
    weight_shapes(inputs);
    return {inputs[0]};
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    std::vector<Shape> shapes;
    if (inputs.size() == 1) shapes.push_back(operand(inputs));
    if (param_.bias_term())
      shapes.push_back(learned_operand(
          inputs[0], param_.axis(),
          inputs.size() == 1 ? param_.num_axes() : static_cast<int64_t>(inputs[1].rank())));
    return shapes;
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>& weights) const override {
    if (inputs.size() == 2) return {};
    return channel_affine(runs(inputs), inputs[0], &weights[0].values,
                          param_.bias_term() ? &weights[1].values : nullptr);
  }

  Kernel bind(const Binding& binding) const override {
    const bool learned = binding.inputs.size() == 1;
    const float* weights = learned ? binding.weights[0].values.data() : nullptr;
    const float* bias = param_.bias_term() ? binding.weights.back().values.data() : nullptr;
    return {"scale", [runs = runs(binding.inputs), threads = binding.threads, learned, weights,
                      bias](const Call& call) {
              const float* in = call.inputs[0];
              const float* scales = learned ? weights : call.inputs[1];
              float* out = call.outputs[0];
              for_each_run(runs, threads, [&](int64_t channel, int64_t begin, int64_t end) {
                const float scale = scales[channel];
                if (bias)
                  for (int64_t i = begin; i < end; ++i) out[i] = in[i] * scale + bias[channel];
                else
                  for (int64_t i = begin; i < end; ++i) out[i] = in[i] * scale;
              });
            }};
  }

 private:
  Shape operand(const std::vector<Shape>& inputs) const {
    return inputs.size() == 2 ? inputs[1]
                              : learned_operand(inputs[0], param_.axis(), param_.num_axes());
  }
  ChannelRuns runs(const std::vector<Shape>& inputs) const {
    return lay_over(operand(inputs), inputs[0], param_.axis());
  }

  caffe::ScaleParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_scale(const caffe::LayerParameter& param) {
  return std::make_unique<Scale>(param.scale_param());
}

}  // namespace revisit::engine
