#include <algorithm>
#include <cmath>

#include "kernels/activation.h"
#include "kernels/channel_runs.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

class PReLU : public OneToOneLayer {
 public:
  explicit PReLU(const caffe::PReLUParameter& param) : shared_(param.channel_shared()) {}

  Shape output_shape(const Shape& input) const override {
    expect_channels(input, "PReLU");
    if (input.rank() > 4) throw InputError("PReLU needs an input of at most 4 axes, found ", input);
    return input;
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    return {shared_ ? Shape{} : Shape{inputs[0][1]}};
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }
  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>& weights) const override {
    std::vector<float> slopes = weights[0].values;
    // Fused kernels keep positive values unchanged; for other slopes bind() has Caffe's expression.
    if (!std::ranges::all_of(slopes, [](float slope) { return std::isfinite(slope); })) return {};
    slopes.resize(inputs[0][1], shared_ && !slopes.empty() ? slopes[0] : 0);
    auto held =
        std::make_shared<const AlignedFloats>(padded(slopes, padded_channels(inputs[0][1])));
    const float* const data = held->data();
    return Activating{{.activation = Epilogue::Activation::kPrelu, .slopes = data},
                      std::move(held)};
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
                for (int64_t i = begin; i < end; ++i) out[i] = leaky_relu(in[i], slope);
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
