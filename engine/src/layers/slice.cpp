#include <algorithm>

#include "kernels/strided_copy.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Cuts the input along one axis: at the given points, or into equal parts.
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
        throw InputError(str("axis ", axis, " of the input (", inputs[0], ") cannot be cut into ",
                             parts, " equal parts; give slice_point"));
      outputs.assign(n_outputs, inputs[0].with(axis, size / parts));
      return outputs;
    }
    if (static_cast<size_t>(param_.slice_point_size()) != n_outputs - 1)
      throw InputError(str("expected ", n_outputs - 1, " slice points for ", n_outputs,
                           " outputs, found ", param_.slice_point_size()));
    int64_t begin = 0;
    for (size_t i = 0; i < n_outputs; ++i) {
      const int64_t end = i + 1 < n_outputs ? param_.slice_point(static_cast<int>(i)) : size;
      if (end <= begin || end > size)
        throw InputError(str("slice points must increase from above 0 to below ", size,
                             ", the size of axis ", axis, " of the input (", inputs[0], ")"));
      outputs.push_back(inputs[0].with(axis, end - begin));
      begin = end;
    }
    return outputs;
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    if (slice_axis(input) + 2 >= input.rank()) return std::nullopt;  // along rows or columns
    return WindowHw{};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    const size_t axis = slice_axis(input);
    const bool blocked = cuts_between_blocks(binding, axis);
    const auto run_of = [&](const Shape& shape) {  // floats that are contiguous
      return blocked ? padded_channels(shape[1]) * shape[2] * shape[3] *
                           value_bytes(binding.precision) / floats(1).count
                     : shape.product(axis, shape.rank());
    };
    const int64_t outer = input.product(0, axis);
    std::vector<StridedCopyProblem> copies;
    int64_t offset = 0;
    for (const Shape& output : binding.outputs) {
      const int64_t size = run_of(output);
      copies.push_back({{outer, size}, {run_of(input), 1}, offset, binding.threads});
      offset += size;
    }
    const auto run = [copies = std::move(copies)](const Call& call) {
      for (size_t i = 0; i < copies.size(); ++i)
        if (call.outputs[i] != call.inputs[0] + copies[i].offset)
          strided_copy(copies[i], call.inputs[0], call.outputs[i]);
    };
    Kernel kernel = blocked ? blocked_kernel("copy", 1, run) : Kernel{"copy", run};
    kernel.cuts_input = outer == 1 && !binding.reference_kernels;
    return kernel;
  }

 private:
  /// Every output but the last fills its blocks.
  static bool cuts_between_blocks(const Binding& binding, size_t axis) {
    return binding.blocked(0) && axis == 1 &&
           std::all_of(binding.outputs.begin(), binding.outputs.end() - 1,
                       [](const Shape& output) { return output[1] % kLanes == 0; });
  }

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
