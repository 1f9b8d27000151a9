#include "layers/join_and_cut.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

Kernel cut_out(const std::vector<int64_t>& offsets, const Binding& binding) {
  const Shape& input = binding.inputs[0];
  StridedCopyProblem copy{binding.outputs[0].axes(), {}, 0, binding.threads};
  for (size_t axis = 0; axis < input.rank(); ++axis) {
    copy.strides.push_back(input.product(axis + 1, input.rank()));
    copy.offset += offsets[axis] * copy.strides.back();
  }
  return copy_kernel("copy", std::move(copy));
}

std::optional<WindowHw> window_at(const std::vector<int64_t>& offsets) {
  const size_t rank = offsets.size();
  if (rank < 2) return std::nullopt;
  return WindowHw{{1, 1, -offsets[rank - 2]}, {1, 1, -offsets[rank - 1]}};
}

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
    const std::vector<int64_t> offsets = offsets_in(input);
    std::vector<int64_t> axes = input.axes();
    for (size_t axis = first; axis < axes.size(); ++axis) {
      if (offsets[axis] + wanted[axis] > input[axis])
        throw InputError("in axis ", axis, ", ", wanted[axis], " values from ", offsets[axis],
                         " on reach past the input (", input, ")");
      axes[axis] = wanted[axis];
    }
    return {Shape(std::move(axes))};
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    return window_at(offsets_in(input));
  }

  Rounding rounding() const override { return Rounding::kNone; }

  Kernel bind(const Binding& binding) const override {
    return cut_out(offsets_in(binding.inputs[0]), binding);
  }

 private:
  size_t first_axis(const Shape& input) const {
    return input.canonical_axis(param_.axis(), "crop axis");
  }

  std::vector<int64_t> offsets_in(const Shape& input) const {
    std::vector<int64_t> offsets(input.rank(), 0);
    const size_t first = first_axis(input);
    for (size_t axis = first; param_.offset_size() > 0 && axis < input.rank(); ++axis)
      offsets[axis] = param_.offset(param_.offset_size() == 1 ? 0 : static_cast<int>(axis - first));
    return offsets;
  }

  caffe::CropParameter param_;
};

class CropCenter : public OneToOneLayer {
 public:
  explicit CropCenter(const caffe::CropCenterParameter& param)
      : cut_(param.crop_size().begin(), param.crop_size().end()) {
    for (const int64_t size : cut_) expect_int(size, "crop_size");
  }

  Shape output_shape(const Shape& input) const override {
    if (cut_.size() != input.rank())
      throw InputError("expected a crop_size for each of the ", input.rank(),
                       " axes of the input (", input, "), found ", cut_.size());
    std::vector<int64_t> axes = input.axes();
    for (size_t axis = 0; axis < axes.size(); ++axis) {
      axes[axis] -= 2 * cut_[axis];
      if (axes[axis] < 1)
        throw InputError("in axis ", axis, ", cutting ", cut_[axis],
                         " values off both ends leaves nothing of the input (", input, ")");
    }
    return Shape(std::move(axes));
  }

  std::optional<WindowHw> window(const Shape&) const override { return window_at(cut_); }

  Kernel bind(const Binding& binding) const override { return cut_out(cut_, binding); }

 private:
  std::vector<int64_t> cut_;
};

}  // namespace

std::unique_ptr<Layer> make_crop(const caffe::LayerParameter& param) {
  return std::make_unique<Crop>(param.crop_param());
}

std::unique_ptr<Layer> make_crop_center(const caffe::LayerParameter& param) {
  return std::make_unique<CropCenter>(param.crop_center_param());
}

}  // namespace revisit::engine
