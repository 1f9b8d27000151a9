#include "layers/layers.h"

namespace revisit::engine {
namespace {

class Identity : public Layer {
 public:
  explicit Identity(const caffe::LayerParameter& param) : is_split_(param.type() == "Split") {
    if (!is_split_ && is_for_training(param))
      throw UnsupportedError("`phase: TRAIN` on a Dropout layer drops values at random: remove it");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 1, "inputs");
    if (n_outputs < 1) throw InputError("expected at least one output");
    return std::vector<Shape>(n_outputs, inputs[0]);
  }
  OutputMemory output_memory() const override { return OutputMemory::kViewOfInput; }
  std::optional<WindowHw> window(const Shape&) const override { return WindowHw{}; }
  bool allows_in_place() const override { return !is_split_; }
  Kernel bind(const Binding&) const override { return {}; }

 private:
  bool is_split_;
};

class ReshapedLike : public Layer {
 public:
  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t) const override {
    return {inputs.at(1)};
  }
  OutputMemory output_memory() const override { return OutputMemory::kViewOfInput; }
  std::optional<WindowHw> window(const Shape&) const override { return WindowHw{}; }
  Kernel bind(const Binding&) const override { return {}; }
};

/// Uses its inputs, so that they are not outputs of the net.
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

std::unique_ptr<Layer> make_identity(const caffe::LayerParameter& param) {
  return std::make_unique<Identity>(param);
}

std::unique_ptr<Layer> make_reshaped_like(const caffe::LayerParameter&) {
  return std::make_unique<ReshapedLike>();
}

std::unique_ptr<Layer> make_silence(const caffe::LayerParameter&) {
  return std::make_unique<Silence>();
}

}  // namespace revisit::engine
