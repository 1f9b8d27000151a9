#include "layers/convolution_window.h"
#include "layers/layers.h"
#include "layers/planar_convolution.h"

namespace revisit::engine {
namespace {

/// How an input maps to outputs and groups. The forks' depthwise layers differ here only.
enum class Flavour {
  kPlain,
  kGroupPerChannel,  // DepthwiseConvolution: the group is the number of channels unless given
  kDepthwise,  // ConvolutionDepthwise: one filter a channel, whatever group and num_output say
};

class Convolution : public Layer {
 public:
  Convolution(const caffe::ConvolutionParameter& param, Flavour flavour)
      : param_(param), flavour_(flavour) {
    if (flavour_ != Flavour::kDepthwise) check_outputs_and_groups(param);
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    check_inputs_and_outputs(inputs, n_outputs);
    const Problem p = problem(inputs[0]);
    return std::vector<Shape>(n_outputs, with_channels(inputs[0], channel_axis(inputs[0]),
                                                       p.c_windows, p.axes, &WindowAxis::windows));
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    const Problem p = problem(inputs[0]);
    return filters_and_bias(p, param_, p.c_windows);
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    return window_of_last_axes(problem(input).axes);
  }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    // Blocked values are images.
    if (inputs[0].rank() != 4 || channel_axis(inputs[0]) != 1) return {};
    return Convolving{planar(problem(inputs[0]))};
  }

  Kernel bind(const Binding& binding) const override {
    Problem p = problem(binding.inputs[0]);
    p.threads = binding.threads;
    Kernel kernel = binding.convolution ? bind_blocked_convolution(planar(p), binding)
                                        : bind_plain_convolution(p, binding);
    kernel.macs = static_cast<int64_t>(binding.outputs.size()) * p.macs();
    return kernel;
  }

 private:
  using Problem = ConvolutionNdProblem;

  size_t channel_axis(const Shape& input) const {
    return input.canonical_axis(param_.axis(), "convolution axis");
  }

  Problem problem(const Shape& input) const {
    const size_t axis = channel_axis(input);
    Problem p;
    p.n = input.product(0, axis);
    p.c_image = input[axis];
    p.c_windows = flavour_ == Flavour::kDepthwise ? p.c_image : param_.num_output();
    const bool per_channel = flavour_ == Flavour::kDepthwise ||
                             (flavour_ == Flavour::kGroupPerChannel && !param_.has_group());
    p.group = per_channel ? p.c_image : param_.group();
    if (p.c_windows % p.group != 0)
      throw InputError(str("num_output ", p.c_windows, " is not a multiple of group ", p.group));
    if (p.c_image % p.group != 0)
      throw InputError(str("the ", p.c_image, " channels of the input (", input,
                           ") are not a multiple of group ", p.group));
    p.axes = window_axes(param_, input.rank() - axis - 1);
    for (size_t i = 0; i < p.axes.size(); ++i) {
      p.axes[i].image = input[axis + 1 + i];
      p.axes[i].windows = count_windows(p.axes[i]);
    }
    return p;
  }

  static ConvolutionProblem planar(const Problem& p) {
    const WindowAxis &h = p.axes[0], &w = p.axes[1];
    return {p.n,       p.c_image,  h.image,    w.image,  p.c_windows, h.windows,
            w.windows, h.kernel,   w.kernel,   h.stride, w.stride,    h.pad,
            w.pad,     h.dilation, w.dilation, p.group,  p.threads};
  }

  caffe::ConvolutionParameter param_;
  Flavour flavour_;
};

}  // namespace

std::unique_ptr<Layer> make_convolution(const caffe::LayerParameter& param) {
  return std::make_unique<Convolution>(param.convolution_param(), Flavour::kPlain);
}

// The CPU path of the fork that has this type is Convolution itself, and its models say `group`;
// its GPU path takes one filter a channel always.
std::unique_ptr<Layer> make_depthwise_convolution(const caffe::LayerParameter& param) {
  return std::make_unique<Convolution>(param.convolution_param(), Flavour::kGroupPerChannel);
}

std::unique_ptr<Layer> make_convolution_depthwise(const caffe::LayerParameter& param) {
  return std::make_unique<Convolution>(param.convolution_param(), Flavour::kDepthwise);
}

}  // namespace revisit::engine
