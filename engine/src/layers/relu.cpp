#include <algorithm>

#include "kernels/parallel.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

class ReLU : public Layer {
 public:
  explicit ReLU(const caffe::ReLUParameter& param) : slope_(param.negative_slope()) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 1, "inputs");
    expect_count(n_outputs, 1, "outputs");
    return inputs;
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }

  Form form(const std::vector<Shape>&, const std::vector<Tensor>&) const override {
    return Activating{{.activation = Epilogue::Activation::kRelu, .slope = slope_}, {}};
  }

  Kernel bind(const Binding& binding) const override {
    const int64_t elements = binding.inputs[0].elements();
    return {"relu", [elements, slope = slope_, threads = binding.threads](const Call& call) {
              const float* in = call.inputs[0];
              float* out = call.outputs[0];
              parallel_ranges(elements, kParallelGrain, threads, [&](int64_t begin, int64_t end) {
                // Caffe's own expression: it decides what becomes of NaN and infinity.
                for (int64_t i = begin; i < end; ++i)
                  out[i] = std::max(in[i], 0.0F) + slope * std::min(in[i], 0.0F);
              });
            }};
  }

 private:
  float slope_;
};

}  // namespace

std::unique_ptr<Layer> make_relu(const caffe::LayerParameter& param) {
  return std::make_unique<ReLU>(param.relu_param());
}

}  // namespace revisit::engine
