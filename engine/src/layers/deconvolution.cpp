#include "layers/convolution_window.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// The adjoint of a convolution: its input is what the convolution would put out.
class Deconvolution : public Layer {
 public:
  explicit Deconvolution(const caffe::ConvolutionParameter& param) : param_(param) {
    check_outputs_and_groups(param);
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    check_inputs_and_outputs(inputs, n_outputs);
    const ConvolutionNdProblem p = problem(inputs[0]);
    return std::vector<Shape>(n_outputs, with_channels(inputs[0], channel_axis(inputs[0]),
                                                       p.c_image, p.axes, &WindowAxis::image));
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    const ConvolutionNdProblem p = problem(inputs[0]);
    return filters_and_bias(p, param_, p.c_image);
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
            floats(chosen.scratch_floats(p)),
            static_cast<int64_t>(binding.inputs.size()) * p.macs()};
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
