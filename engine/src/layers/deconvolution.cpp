#include "kernels/convolution_nd.h"
#include "layers/convolution_window.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// The adjoint of a convolution: its input is what the convolution would put out.
class Deconvolution : public Layer {
 public:
  explicit Deconvolution(const caffe::ConvolutionParameter& param) : param_(param) {
    if (param.num_output() < 1) throw InputError("num_output must be at least 1");
    if (param.group() < 1) throw InputError("group must be at least 1");
    if (param.num_output() % param.group() != 0)
      throw InputError(
          str("num_output ", param.num_output(), " is not a multiple of group ", param.group()));
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    if (inputs.empty()) throw InputError("expected at least one input");
    expect_count(n_outputs, inputs.size(), "outputs");
    const Shape& input = inputs[0];
    for (const Shape& other : inputs)
      if (other != input) throw InputError(str("inputs differ in shape: ", input, " and ", other));
    const ConvolutionNdProblem p = problem(input);
    std::vector<int64_t> axes(input.axes().begin(),
                              input.axes().begin() + static_cast<int64_t>(channel_axis(input)));
    axes.push_back(p.c_image);
    for (const WindowAxis& axis : p.axes) axes.push_back(axis.image);
    return std::vector<Shape>(n_outputs, Shape(std::move(axes)));
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    const ConvolutionNdProblem p = problem(inputs[0]);
    std::vector<int64_t> weight{p.c_windows, p.c_image_per_group()};
    for (const WindowAxis& axis : p.axes) weight.push_back(axis.kernel);
    std::vector<Shape> shapes{Shape(std::move(weight))};
    if (param_.bias_term()) shapes.push_back(Shape{p.c_image});
    return shapes;
  }

  Kernel bind(const Binding& binding) const override {
    ConvolutionNdProblem p = problem(binding.inputs[0]);
    p.threads = binding.threads;
    const ConvolutionNdKernel& chosen =
        binding.reference_kernels ? kDeconvolutionReference : kDeconvolutionGemm;
    const float* weights = binding.weights[0].values.data();
    const float* bias = param_.bias_term() ? binding.weights[1].values.data() : nullptr;
    return {chosen.name,
            [p, &chosen, weights, bias](const Call& call) {
              for (size_t i = 0; i < call.inputs.size(); ++i)
                chosen.run(p, call.inputs[i], weights, bias, call.outputs[i], call.scratch);
            },
            chosen.scratch_floats(p), static_cast<int64_t>(binding.inputs.size()) * p.macs()};
  }

 private:
  size_t channel_axis(const Shape& input) const {
    return input.canonical_axis(param_.axis(), "deconvolution axis");
  }

  ConvolutionNdProblem problem(const Shape& input) const {
    const size_t axis = channel_axis(input);
    ConvolutionNdProblem p;
    p.n = input.product(0, axis);
    p.c_windows = input[axis];
    p.c_image = param_.num_output();
    p.group = param_.group();
    if (p.c_windows % p.group != 0)
      throw InputError(str("the ", p.c_windows, " channels of the input (", input,
                           ") are not a multiple of group ", p.group));
    p.axes = window_axes(param_, input.rank() - axis - 1);
    for (size_t i = 0; i < p.axes.size(); ++i) {
      p.axes[i].windows = input[axis + 1 + i];
      p.axes[i].image = count_pixels(p.axes[i]);
    }
    return p;
  }

  caffe::ConvolutionParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_deconvolution(const caffe::LayerParameter& param) {
  return std::make_unique<Deconvolution>(param.convolution_param());
}

}  // namespace revisit::engine
