#include <algorithm>

#include "layers/join_and_cut.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Transposition: axis i of the output is axis order[i] of the input.
class Permute : public OneToOneLayer {
 public:
  /// `field` is the name of `order` in the file.
  Permute(std::vector<int64_t> order, const char* field) : order_(std::move(order)), field_(field) {
    std::vector<int64_t> sorted = order_;
    std::sort(sorted.begin(), sorted.end());
    const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
    if (twice != sorted.end()) throw InputError(field_, " names axis ", *twice, " twice");
  }

  Shape output_shape(const Shape& input) const override {
    for (const int64_t axis : order_)
      if (axis < 0 || axis >= static_cast<int64_t>(input.rank()))
        throw InputError(field_, " names axis ", axis, ", the input is ", input);
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
    StridedCopyProblem copy{{1}, {0}, 0, binding.threads};  // a leading axis, for scalars
    for (const size_t axis : whole_order(input.rank())) {
      copy.shape.push_back(input[axis]);
      copy.strides.push_back(input.product(axis + 1, input.rank()));
    }
    return copy_kernel("transpose", std::move(copy));
  }

 protected:
  size_t n_named() const { return order_.size(); }

 private:
  std::vector<size_t> whole_order(size_t rank) const {
    std::vector<size_t> order(order_.begin(), order_.end());
    for (size_t axis = 0; axis < rank; ++axis)
      if (std::find(order_.begin(), order_.end(), axis) == order_.end()) order.push_back(axis);
    return order;
  }

  std::vector<int64_t> order_;
  const char* field_;
};

/// Permute with all axes listed (tianzhi0549/CTPN, transpose_layer.cpp).
class Transpose : public Permute {
 public:
  explicit Transpose(const caffe::TransposeParameter& param)
      : Permute({param.dim().begin(), param.dim().end()}, "dim") {}

  Shape output_shape(const Shape& input) const override {
    if (n_named() != input.rank() || n_named() == 0)
      throw InputError("dim must name each of the ", input.rank(), " axes of the input (", input,
                       "), found ", n_named());
    return Permute::output_shape(input);
  }
};

}  // namespace

std::unique_ptr<Layer> make_permute(const caffe::LayerParameter& param) {
  const auto& order = param.permute_param().order();
  return std::make_unique<Permute>(std::vector<int64_t>(order.begin(), order.end()), "order");
}

std::unique_ptr<Layer> make_transpose(const caffe::LayerParameter& param) {
  return std::make_unique<Transpose>(param.transpose_param());
}

}  // namespace revisit::engine
