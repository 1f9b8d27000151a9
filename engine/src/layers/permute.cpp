#include <algorithm>

#include "layers/join_and_cut.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Transposes: axis i of the output is axis order[i] of the input (the layer of the SSD fork).
class Permute : public OneToOneLayer {
 public:
  explicit Permute(const caffe::PermuteParameter& param)
      : order_(param.order().begin(), param.order().end()) {
    std::vector<size_t> sorted = order_;
    std::sort(sorted.begin(), sorted.end());
    const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
    if (twice != sorted.end()) throw InputError("order names axis ", *twice, " twice");
  }

  Shape output_shape(const Shape& input) const override {
    for (const size_t axis : order_)
      if (axis >= input.rank())
        throw InputError("order names axis ", axis, ", the input is ", input);
    std::vector<int64_t> axes;
    for (const size_t axis : whole_order(input.rank())) axes.push_back(input[axis]);
    return Shape(std::move(axes));
  }

  bool keeps_items(size_t, const std::vector<Shape>&) const override {
    return order_.empty() || order_[0] == 0;
  }

  Rounding rounding() const override { return Rounding::kNone; }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    StridedCopyProblem copy{{1}, {0}, 0, binding.threads};  // a leading axis, for single numbers
    for (const size_t axis : whole_order(input.rank())) {
      copy.shape.push_back(input[axis]);
      copy.strides.push_back(input.product(axis + 1, input.rank()));
    }
    return copy_kernel("transpose", std::move(copy));
  }

 private:
  /// Axes that `order` does not name follow in their old order.
  std::vector<size_t> whole_order(size_t rank) const {
    std::vector<size_t> order = order_;
    for (size_t axis = 0; axis < rank; ++axis)
      if (std::find(order_.begin(), order_.end(), axis) == order_.end()) order.push_back(axis);
    return order;
  }

  std::vector<size_t> order_;
};

}  // namespace

std::unique_ptr<Layer> make_permute(const caffe::LayerParameter& param) {
  return std::make_unique<Permute>(param.permute_param());
}

}  // namespace revisit::engine
