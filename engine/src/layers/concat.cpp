#include <algorithm>

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
        throw InputError(
            str("inputs must agree in all axes but ", axis, ", found ", inputs[0], " and ", input));
      total += input[axis];
    }
    return {inputs[0].with(axis, total)};
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    if (concat_axis(input) + 2 >= input.rank()) return std::nullopt;  // along rows or columns
    return WindowHw{};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& output = binding.outputs[0];
    const size_t axis = concat_axis(output);
    const bool blocked = joins_blocks(binding, axis);
    std::vector<int64_t> runs;  // floats that are contiguous in each input
    for (const Shape& input : binding.inputs)
      runs.push_back(blocked ? padded_channels(input[1]) * input[2] * input[3] *
                                   value_bytes(binding.precision) / floats(1).count
                             : input.product(axis, input.rank()));
    const int64_t outer = output.product(0, axis);
    Kernel kernel{"copy", [outer, runs = std::move(runs)](const Call& call) {
                    float* out = call.outputs[0];
                    for (int64_t i = 0; i < outer; ++i)
                      for (size_t input = 0; input < runs.size(); ++input)
                        out = std::copy_n(call.inputs[input] + i * runs[input], runs[input], out);
                  }};
    kernel.joins_inputs = outer == 1 && !binding.reference_kernels;
    if (blocked) {
      kernel.reads.assign(binding.inputs.size(), Layout::kNChw16c);
      kernel.writes = Layout::kNChw16c;
    }
    return kernel;
  }

 private:
  /// Channels can be joined in blocks when every input but the last fills its blocks.
  static bool joins_blocks(const Binding& binding, size_t axis) {
    if (axis != 1 || binding.outputs[0].rank() != 4) return false;
    bool any_blocked = false;
    for (size_t i = 0; i < binding.inputs.size(); ++i) {
      any_blocked |= binding.blocked(i);
      if (i + 1 < binding.inputs.size() && binding.inputs[i][1] % kLanes != 0) return false;
    }
    return any_blocked;
  }

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
