#include <algorithm>

#include "kernels/channels.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// ReLU with a learned slope below 0: one for each channel, or one for all.
class PReLU : public Layer {
 public:
  explicit PReLU(const caffe::PReLUParameter& param) : shared_(param.channel_shared()) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 1, "inputs");
    expect_count(n_outputs, 1, "outputs");
    if (inputs[0].rank() < 2)
      throw InputError(str("PReLU needs an input of at least 2 axes, found ", inputs[0]));
    return inputs;
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    return {shared_ ? Shape{} : Shape{inputs[0][1]}};
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>& weights) const override {
    std::vector<float> slopes = weights[0].values;
    slopes.resize(inputs[0][1], shared_ && !slopes.empty() ? slopes[0] : 0);
    return Activating{{.activation = Epilogue::Activation::kPrelu}, std::move(slopes)};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& shape = binding.inputs[0];
    const ChannelRuns runs = shared_
                                 ? ChannelRuns{1, 1, shape.elements()}
                                 : ChannelRuns{shape[0], shape[1], shape.product(2, shape.rank())};
    return {"prelu", [runs, slopes = binding.weights[0].values.data(),
                      threads = binding.threads](const Call& call) {
              const float* in = call.inputs[0];
              float* out = call.outputs[0];
              for_each_run(runs, threads, [&](int64_t channel, int64_t begin, int64_t end) {
                const float slope = slopes[channel];
                for (int64_t i = begin; i < end; ++i)
                  out[i] = std::max(in[i], 0.0F) + slope * std::min(in[i], 0.0F);
              });
            }};
  }

 private:
  bool shared_;
};

}  // namespace

std::unique_ptr<Layer> make_prelu(const caffe::LayerParameter& param) {
  return std::make_unique<PReLU>(param.prelu_param());
}

}  // namespace revisit::engine
