#include "kernels/nchw.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

class Lrn : public OneToOneLayer {
 public:
  explicit Lrn(const caffe::LRNParameter& param) : param_(param) {
    if (param.local_size() % 2 == 0)
      throw InputError("local_size must be odd, found ", param.local_size());
    expect_int(param.local_size(), "local_size");
  }

  Shape output_shape(const Shape& input) const override {
    expect_image(input, "LRN");
    return input;
  }

  std::optional<WindowHw> window(const Shape&) const override {
    if (across()) return WindowHw{};
    const Window square{param_.local_size(), 1, param_.local_size() / 2};
    return WindowHw{square, square};
  }

  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    return across() ? Form(problem_of(inputs[0])) : Form();
  }

  Kernel bind(const Binding& binding) const override {
    LrnProblem problem = problem_of(binding.inputs[0]);
    problem.threads = binding.threads;
    if (!across())
      return {"lrn-within", [problem](const Call& call) {
                lrn_within_channel(problem, call.inputs[0], call.outputs[0]);
              }};
    auto* const run =
        binding.reference_kernels ? lrn_across_channels_reference : lrn_across_channels;
    return {binding.reference_kernels ? "reference" : "lrn-across",
            [problem, run](const Call& call) { run(problem, call.inputs[0], call.outputs[0]); }};
  }

 private:
  bool across() const { return param_.norm_region() == caffe::LRNParameter::ACROSS_CHANNELS; }

  LrnProblem problem_of(const Shape& shape) const {
    return {shape[0],       shape[1],      shape[2],  shape[3], param_.local_size(),
            param_.alpha(), param_.beta(), param_.k()};
  }

  caffe::LRNParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_lrn(const caffe::LayerParameter& param) {
  return std::make_unique<Lrn>(param.lrn_param());
}

}  // namespace revisit::engine
