#include "layers/join_and_cut.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

class Slice : public Layer {
 public:
  explicit Slice(const caffe::SliceParameter& param) : param_(param) {
    if (param.has_axis() && param.has_slice_dim())
      throw InputError("give axis or slice_dim, not both");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 1, "inputs");
    if (n_outputs < 1) throw InputError("expected at least one output");
    const size_t axis = slice_axis(inputs[0]);
    const int64_t size = inputs[0][axis];
    std::vector<Shape> outputs;
    if (param_.slice_point_size() == 0) {
      const auto parts = static_cast<int64_t>(n_outputs);
      if (size % parts != 0)
        throw InputError("axis ", axis, " of the input (", inputs[0], ") cannot be cut into ",
                         parts, " equal parts; give slice_point");
      outputs.assign(n_outputs, inputs[0].with(axis, size / parts));
      return outputs;
    }
    if (static_cast<size_t>(param_.slice_point_size()) != n_outputs - 1)
      throw InputError("expected ", n_outputs - 1, " slice points for ", n_outputs,
                       " outputs, found ", param_.slice_point_size());
    int64_t begin = 0;
    for (size_t i = 0; i < n_outputs; ++i) {
      const int64_t end = i + 1 < n_outputs ? param_.slice_point(static_cast<int>(i)) : size;
      if (end <= begin || end > size)
        throw InputError("slice points must increase from above 0 to below ", size,
                         ", the size of axis ", axis, " of the input (", inputs[0], ")");
      outputs.push_back(inputs[0].with(axis, end - begin));
      begin = end;
    }
    return outputs;
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    return window_across(slice_axis(input), input);
  }

  Rounding rounding() const override { return Rounding::kNone; }

  bool keeps_items(size_t, const std::vector<Shape>& inputs) const override {
    return slice_axis(inputs[0]) > 0;
  }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    return inputs[0].rank() == 4 && slice_axis(inputs[0]) == 1 ? Form(Cutting{}) : Form();
  }

  Kernel bind(const Binding& binding) const override {
    const size_t axis = slice_axis(binding.inputs[0]);
    std::vector<int64_t> sizes;
    for (const Shape& output : binding.outputs)
      sizes.push_back(output.product(axis, output.rank()));
    Kernel kernel = cut_kernel(binding.inputs[0].product(0, axis), sizes, binding.threads);
    if (binding.reference_kernels) kernel.aliasing = Aliasing::kNone;
    return kernel;
  }

 private:
  size_t slice_axis(const Shape& input) const {
    return input.canonical_axis(
        param_.has_slice_dim() ? static_cast<int64_t>(param_.slice_dim()) : param_.axis(),
        "slice axis");
  }

  caffe::SliceParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_slice(const caffe::LayerParameter& param) {
  return std::make_unique<Slice>(param.slice_param());
}

}  // namespace revisit::engine
