#include <algorithm>

#include "layers/join_and_cut.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

class Reversing : public OneToOneLayer {
 public:
  Shape output_shape(const Shape& input) const override {
    reversed(input);
    return input;
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    const std::vector<bool> axes = reversed(input);
    for (size_t axis = 0; axis < axes.size(); ++axis)
      if (axes[axis] && !window_across(axis, input)) return std::nullopt;
    return WindowHw{};
  }

  Rounding rounding() const override { return Rounding::kNone; }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    const std::vector<bool> axes = reversed(inputs[0]);
    if (axes.size() < 2 || !axes[1] || std::count(axes.begin(), axes.end(), true) != 1) return {};
    Shuffling shuffling;
    for (int64_t c = inputs[0][1]; c > 0; --c) shuffling.sources.push_back(c - 1);
    return shuffling;
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    const std::vector<bool> axes = reversed(input);
    StridedCopyProblem copy{{1}, {0}, 0, binding.threads};  // a leading axis, for scalars
    for (size_t axis = 0; axis < axes.size(); ++axis) {
      const int64_t stride = input.product(axis + 1, input.rank());
      if (axes[axis]) copy.offset += (input[axis] - 1) * stride;
      if (axis == 0 || axes[axis] != axes[axis - 1]) {
        copy.shape.push_back(1);
        copy.strides.push_back(0);
      }
      copy.shape.back() *= input[axis];  // merges adjacent axes with the same direction
      copy.strides.back() = axes[axis] ? -stride : stride;
    }
    return copy_kernel("reverse", std::move(copy));
  }

 protected:
  /// Returns for each axis of the input whether it is reversed. Throws InputError for invalid axes.
  virtual std::vector<bool> reversed(const Shape& input) const = 0;
};

/// tianzhi0549/CTPN, reverse_layer.cpp: one axis, by default 0. Synopsys' fork
/// (foss-for-synopsys-dwc-arc-processors/synopsys-caffe) has several axes, which may be negative.
/// Without axes it is the identity, which cannot be distinguished from CTPN's default.
class Reverse : public Reversing {
 public:
  explicit Reverse(const caffe::ReverseParameter& param)
      : axes_(param.axis().begin(), param.axis().end()) {
    if (axes_.empty()) axes_ = {0};
  }

 protected:
  std::vector<bool> reversed(const Shape& input) const override {
    std::vector<bool> result(input.rank());
    for (const int32_t named : axes_) {
      const size_t axis = input.canonical_axis(named, "reverse axis");
      if (result[axis])
        throw InputError("axis ", axis, " of the input (", input, ") is named twice");
      result[axis] = true;
    }
    return result;
  }

 private:
  std::vector<int32_t> axes_;
};

/// happynear/caffe-windows, flip_layer.cpp: mirrors images. Missing axes count as size 1.
class Flip : public Reversing {
 public:
  explicit Flip(const caffe::FlipParameter& param) : param_(param) {}

 protected:
  std::vector<bool> reversed(const Shape& input) const override {
    if (input.rank() > 4)
      throw InputError("Flip needs an input of at most 4 axes (n x c x h x w), found ", input);
    std::vector<bool> result{false, false, param_.flip_height(), param_.flip_width()};
    result.resize(input.rank());
    return result;
  }

 private:
  caffe::FlipParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_reverse(const caffe::LayerParameter& param) {
  return std::make_unique<Reverse>(param.reverse_param());
}

std::unique_ptr<Layer> make_flip(const caffe::LayerParameter& param) {
  return std::make_unique<Flip>(param.flip_param());
}

}  // namespace revisit::engine
