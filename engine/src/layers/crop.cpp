#include "kernels/strided_copy.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Cuts the first input to the size of the second, in the axes from `axis` on.
class Crop : public Layer {
 public:
  explicit Crop(const caffe::CropParameter& param) : param_(param) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 2, "inputs");
    expect_count(n_outputs, 1, "outputs");
    const Shape &input = inputs[0], &wanted = inputs[1];
    const size_t first = first_axis(input);
    const auto n_offsets = static_cast<size_t>(param_.offset_size());
    if (n_offsets > 1 && first + n_offsets != input.rank())
      throw InputError("expected one offset, or one for each of the ", input.rank() - first,
                       " axes from axis ", first, " on, found ", n_offsets);
    if (wanted.rank() < input.rank())
      throw InputError("the second input (", wanted, ") has fewer axes than the first (", input,
                       ")");
    std::vector<int64_t> axes = input.axes();
    for (size_t axis = first; axis < axes.size(); ++axis) {
      if (offset(axis, first) + wanted[axis] > input[axis])
        throw InputError("in axis ", axis, ", ", wanted[axis], " values from ", offset(axis, first),
                         " on reach past the input (", input, ")");
      axes[axis] = wanted[axis];
    }
    return {Shape(std::move(axes))};
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    const size_t first = first_axis(input), rank = input.rank();
    const auto along = [&](size_t axis) {
      return Window{1, 1, axis >= first ? -offset(axis, first) : 0};
    };
    if (rank < 2) return std::nullopt;
    return WindowHw{along(rank - 2), along(rank - 1)};
  }

  Rounding rounding() const override { return Rounding::kNone; }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    const size_t first = first_axis(input);
    StridedCopyProblem copy{binding.outputs[0].axes(), {}, 0, binding.threads};
    for (size_t axis = 0; axis < input.rank(); ++axis) {
      copy.strides.push_back(input.product(axis + 1, input.rank()));
      if (axis >= first) copy.offset += offset(axis, first) * copy.strides.back();
    }
    return {"copy", [copy = std::move(copy)](const Call& call) {
              strided_copy(copy, call.inputs[0], call.outputs[0]);
            }};
  }

 private:
  size_t first_axis(const Shape& input) const {
    return input.canonical_axis(param_.axis(), "crop axis");
  }

  int64_t offset(size_t axis, size_t first) const {
    if (param_.offset_size() == 0) return 0;
    return param_.offset(param_.offset_size() == 1 ? 0 : static_cast<int>(axis - first));
  }

  caffe::CropParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_crop(const caffe::LayerParameter& param) {
  return std::make_unique<Crop>(param.crop_param());
}

}  // namespace revisit::engine
