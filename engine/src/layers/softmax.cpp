#include <algorithm>
#include <cmath>

#include "layers/layers.h"

namespace revisit::engine {
namespace {

class Softmax : public Layer {
 public:
  explicit Softmax(const caffe::SoftmaxParameter& param) : axis_(param.axis()) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 1, "inputs");
    expect_count(n_outputs, 1, "outputs");
    inputs[0].canonical_axis(axis_, "softmax axis");
    return inputs;
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    if (input.canonical_axis(axis_, "softmax axis") + 2 >= input.rank()) return std::nullopt;
    return WindowHw{};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& shape = binding.inputs[0];
    const size_t axis = shape.canonical_axis(axis_, "softmax axis");
    const int64_t outer = shape.product(0, axis), classes = shape[axis];
    const int64_t inner = shape.product(axis + 1, shape.rank());
    return {"softmax", [outer, classes, inner](const Call& call) {
              for (int64_t o = 0; o < outer; ++o)
                for (int64_t i = 0; i < inner; ++i)
                  normalise(call.inputs[0] + o * classes * inner + i, classes, inner,
                            call.outputs[0] + o * classes * inner + i);
            }};
  }

 private:
  /// exp(x - max) / sum along one line of `classes` values, `stride` apart.
  static void normalise(const float* in, int64_t classes, int64_t stride, float* out) {
    float largest = in[0];
    for (int64_t c = 1; c < classes; ++c) largest = std::max(largest, in[c * stride]);
    float sum = 0;
    for (int64_t c = 0; c < classes; ++c)
      sum += out[c * stride] = std::exp(in[c * stride] - largest);
    for (int64_t c = 0; c < classes; ++c) out[c * stride] /= sum;
  }

  int axis_;
};

}  // namespace

std::unique_ptr<Layer> make_softmax(const caffe::LayerParameter& param) {
  return std::make_unique<Softmax>(param.softmax_param());
}

}  // namespace revisit::engine
