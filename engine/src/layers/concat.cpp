#include "layers/join_and_cut.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

class Concat : public Layer {
 public:
  explicit Concat(const caffe::ConcatParameter& param) : param_(param) {
    if (param.has_axis() && param.has_concat_dim())
      throw InputError("give axis or concat_dim, not both");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    if (inputs.empty()) throw InputError("expected at least one input");
    expect_count(n_outputs, 1, "outputs");
    const size_t axis = concat_axis(inputs[0]);
    int64_t total = 0;
    for (const Shape& input : inputs) {
      if (input.rank() != inputs[0].rank() || input.with(axis, 1) != inputs[0].with(axis, 1))
        throw InputError("inputs must agree in all axes but ", axis, ", found ", inputs[0], " and ",
                         input);
      total += input[axis];
    }
    return {inputs[0].with(axis, total)};
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    return window_across(concat_axis(input), input);
  }

  Rounding rounding() const override { return Rounding::kNone; }

  bool keeps_items(size_t, const std::vector<Shape>& inputs) const override {
    return concat_axis(inputs[0]) > 0;
  }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    return inputs[0].rank() == 4 && concat_axis(inputs[0]) == 1 ? Form(Joining{}) : Form();
  }

  Kernel bind(const Binding& binding) const override {
    const size_t axis = concat_axis(binding.outputs[0]);
    std::vector<int64_t> sizes;
    for (const Shape& input : binding.inputs) sizes.push_back(input.product(axis, input.rank()));
    Kernel kernel = join_kernel(binding.outputs[0].product(0, axis), sizes);
    if (binding.reference_kernels) kernel.aliasing = Aliasing::kNone;
    return kernel;
  }

 private:
  size_t concat_axis(const Shape& shape) const {
    return shape.canonical_axis(
        param_.has_concat_dim() ? static_cast<int64_t>(param_.concat_dim()) : param_.axis(),
        "concat axis");
  }

  caffe::ConcatParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_concat(const caffe::LayerParameter& param) {
  return std::make_unique<Concat>(param.concat_param());
}

}  // namespace revisit::engine
