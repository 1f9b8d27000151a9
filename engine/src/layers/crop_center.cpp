#include "kernels/strided_copy.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Cuts as many values off both ends of each axis as its crop_size says (the layer of
/// waifu2x-caffe's fork).
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

  std::optional<WindowHw> window(const Shape& input) const override {
    const size_t rank = input.rank();
    if (rank < 2) return std::nullopt;
    return WindowHw{{1, 1, -cut_[rank - 2]}, {1, 1, -cut_[rank - 1]}};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    StridedCopyProblem copy{binding.outputs[0].axes(), {}, 0, binding.threads};
    for (size_t axis = 0; axis < input.rank(); ++axis) {
      copy.strides.push_back(input.product(axis + 1, input.rank()));
      copy.offset += cut_[axis] * copy.strides.back();
    }
    return {"copy", [copy = std::move(copy)](const Call& call) {
              strided_copy(copy, call.inputs[0], call.outputs[0]);
            }};
  }

 private:
  std::vector<int64_t> cut_;  // of each axis
};

}  // namespace

std::unique_ptr<Layer> make_crop_center(const caffe::LayerParameter& param) {
  return std::make_unique<CropCenter>(param.crop_center_param());
}

}  // namespace revisit::engine
