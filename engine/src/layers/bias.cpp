#include "layers/broadcast.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// input + bias, broadcast. The bias is learned or the second input.
class Bias : public Layer {
 public:
  explicit Bias(const caffe::BiasParameter& param) : param_(param) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    if (inputs.empty() || inputs.size() > 2)
      throw InputError(str("expected 1 or 2 inputs, found ", inputs.size()));
    expect_count(n_outputs, 1, "outputs");
    runs(inputs);
    return {inputs[0]};
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    if (inputs.size() == 2) return {};
    return {operand(inputs)};
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>& weights) const override {
    if (inputs.size() == 2) return {};
    return channel_affine(runs(inputs), inputs[0], nullptr, &weights[0].values);
  }

  Kernel bind(const Binding& binding) const override {
    const bool learned = binding.inputs.size() == 1;
    const float* weights = learned ? binding.weights[0].values.data() : nullptr;
    return {"bias", [runs = runs(binding.inputs), threads = binding.threads, learned,
                     weights](const Call& call) {
              const float* in = call.inputs[0];
              const float* biases = learned ? weights : call.inputs[1];
              float* out = call.outputs[0];
              for_each_run(runs, threads, [&](int64_t channel, int64_t begin, int64_t end) {
                const float bias = biases[channel];
                for (int64_t i = begin; i < end; ++i) out[i] = in[i] + bias;
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

  caffe::BiasParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_bias(const caffe::LayerParameter& param) {
  return std::make_unique<Bias>(param.bias_param());
}

}  // namespace revisit::engine
