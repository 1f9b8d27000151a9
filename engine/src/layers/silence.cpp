#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Takes inputs so that they are not outputs of the net; does nothing.
class Silence : public Layer {
 public:
  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    if (inputs.empty()) throw InputError("expected at least one input");
    expect_count(n_outputs, 0, "outputs");
    return {};
  }
  OutputMemory output_memory() const override { return OutputMemory::kViewOfInput; }
  Kernel bind(const Binding&) const override { return {}; }
};

}  // namespace

std::unique_ptr<Layer> make_silence(const caffe::LayerParameter&) {
  return std::make_unique<Silence>();
}

}  // namespace revisit::engine
