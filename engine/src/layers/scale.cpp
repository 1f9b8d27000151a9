#include "kernels/channel_norm.h"
#include "layers/broadcast.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// input * scale + bias (Scale) or input + bias (Bias). The bias of a Scale is always trained.
class Affine : public Layer {
 public:
  explicit Affine(const caffe::ScaleParameter& param)
      : scales_(true), has_bias_(param.bias_term()), axis_(param.axis()), axes_(param.num_axes()) {}
  explicit Affine(const caffe::BiasParameter& param)
      : scales_(false), has_bias_(true), axis_(param.axis()), axes_(param.num_axes()) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    if (inputs.empty() || inputs.size() > 2)
      throw InputError("expected 1 or 2 inputs, found ", inputs.size());
    expect_count(n_outputs, 1, "outputs");
    runs(inputs);
    weight_shapes(inputs);
    return {inputs[0]};
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    std::vector<Shape> shapes;
    if (inputs.size() == 1) shapes.push_back(operand(inputs));
    if (scales_ && has_bias_)
      shapes.push_back(trained_operand(
          inputs[0], axis_, inputs.size() == 1 ? axes_ : static_cast<int64_t>(inputs[1].rank())));
    return shapes;
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }

  bool keeps_items(size_t port, const std::vector<Shape>& inputs) const override {
    const bool operand_has_items = inputs[0].canonical_axis(axis_, "axis") == 0;
    return inputs.size() == 1 ? !operand_has_items : port == 0 || operand_has_items;
  }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>& weights) const override {
    if (inputs.size() == 2) return gating(inputs);
    return channel_affine(runs(inputs), inputs[0], scales_ ? &weights.front().values : nullptr,
                          has_bias_ ? &weights.back().values : nullptr);
  }

  Kernel bind(const Binding& binding) const override {
    const bool learned = binding.inputs.size() == 1;
    const float* first = learned ? binding.weights[0].values.data() : nullptr;
    const float* last = scales_ && has_bias_ ? binding.weights.back().values.data() : nullptr;
    return {scales_ ? "scale" : "bias", [runs = runs(binding.inputs), threads = binding.threads,
                                         scales = scales_, learned, first, last](const Call& call) {
              const float* operand = learned ? first : call.inputs[1];
              for_each_run(runs, threads, [&](int64_t channel, int64_t begin, int64_t end) {
                const float value = operand[channel];
                const ChannelNorm norm =
                    scales ? ChannelNorm{.factor = value, .shift = last ? last[channel] : -0.0F}
                           : ChannelNorm{.shift = value};
                normalize(norm, call.inputs[0] + begin, end - begin, call.outputs[0] + begin);
              });
            }};
  }

 private:
  Form gating(const std::vector<Shape>& inputs) const {
    const Shape& x = inputs[0];
    if (!scales_ || has_bias_ || x.rank() < 2) return {};
    const ChannelRuns factors = runs(inputs);
    if (factors.outer != 1 || factors.channels != x[0] * x[1]) return {};
    return Gating{.x = 0, .factors = 1};
  }

  /// Shape of the second input (a fused addend may follow it) or of the trained operand.
  Shape operand(const std::vector<Shape>& inputs) const {
    return inputs.size() == 1 ? trained_operand(inputs[0], axis_, axes_) : inputs[1];
  }
  ChannelRuns runs(const std::vector<Shape>& inputs) const {
    return lay_over(operand(inputs), inputs[0], axis_);
  }

  bool scales_, has_bias_;
  int64_t axis_, axes_;  // first axis of the operand; its number of axes if it is trained
};

}  // namespace

std::unique_ptr<Layer> make_scale(const caffe::LayerParameter& param) {
  return std::make_unique<Affine>(param.scale_param());
}

std::unique_ptr<Layer> make_bias(const caffe::LayerParameter& param) {
  return std::make_unique<Affine>(param.bias_param());
}

}  // namespace revisit::engine
