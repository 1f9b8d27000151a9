#include "layers/layers.h"

namespace revisit::engine {
namespace {

class EuclideanLoss : public Layer {
 public:
  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 2, "inputs");
    expect_count(n_outputs, 1, "outputs");
    const Shape &a = inputs[0], &b = inputs[1];
    if (a.rank() < 1 || b.rank() < 1 || a[0] != b[0] || a.elements() != b.elements())
      throw InputError(
          "expected equal numbers of images and of values per image in both inputs, found ", a,
          " and ", b);
    return {Shape{}};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& shape = binding.inputs[0];
    return {"euclidean-loss", [n = shape.elements(), images = shape[0]](const Call& call) {
              double sum = 0;
              for (int64_t i = 0; i < n; ++i) {
                const double difference = call.inputs[0][i] - call.inputs[1][i];
                sum += difference * difference;
              }
              *call.outputs[0] = static_cast<float>(sum / static_cast<double>(images) / 2);
            }};
  }
};

}  // namespace

std::unique_ptr<Layer> make_euclidean_loss(const caffe::LayerParameter&) {
  return std::make_unique<EuclideanLoss>();
}

}  // namespace revisit::engine
