#include "kernels/nchw.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

class Softmax : public OneToOneLayer {
 public:
  explicit Softmax(const caffe::SoftmaxParameter& param) : axis_(param.axis()) {}

  Shape output_shape(const Shape& input) const override {
    input.canonical_axis(axis_, "softmax axis");
    return input;
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    return window_across(input.canonical_axis(axis_, "softmax axis"), input);
  }

  bool keeps_items(size_t, const std::vector<Shape>& inputs) const override {
    return inputs[0].canonical_axis(axis_, "softmax axis") > 0;
  }

  Rounding rounding() const override { return Rounding::kCompared; }

  bool allows_in_place() const override { return true; }  // because Caffe copies its input first

  Kernel bind(const Binding& binding) const override {
    const Shape& shape = binding.inputs[0];
    const size_t axis = shape.canonical_axis(axis_, "softmax axis");
    const ClassLines lines{shape.product(0, axis), shape[axis],
                           shape.product(axis + 1, shape.rank())};
    if (binding.reference_kernels)
      return {"reference", [lines](const Call& call) {
                softmax_reference(call.inputs[0], lines, call.outputs[0]);
              }};
    return {"softmax", [lines, threads = binding.threads](const Call& call) {
              softmax(call.inputs[0], lines, call.outputs[0], threads);
            }};
  }

 private:
  int axis_;
};

}  // namespace

std::unique_ptr<Layer> make_softmax(const caffe::LayerParameter& param) {
  return std::make_unique<Softmax>(param.softmax_param());
}

}  // namespace revisit::engine
