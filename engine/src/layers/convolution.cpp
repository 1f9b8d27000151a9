#include "layers/convolution.h"

#include <algorithm>

#include "layers/layers.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

enum class Flavor {
  kPlain,
  kGroupPerChannel,  // DepthwiseConvolution: by default one group per channel
  kDepthwise,        // ConvolutionDepthwise: one filter per channel, ignoring group and num_output
  kTransposed,       // Deconvolution, the adjoint: its input is the output of a convolution
};

class Convolution : public Layer {
 public:
  Convolution(const caffe::ConvolutionParameter& param, Flavor flavor)
      : param_(param), flavor_(flavor), transposed_(flavor == Flavor::kTransposed) {
    if (flavor_ != Flavor::kDepthwise) check_outputs_and_groups(param);
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    check_inputs_and_outputs(inputs, n_outputs);
    const Problem p = problem(inputs[0]);
    return std::vector<Shape>(
        n_outputs, with_channels(inputs[0], channel_axis(inputs[0]), outputs_of(p), p.axes,
                                 transposed_ ? &WindowAxis::image : &WindowAxis::windows));
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    const Problem p = problem(inputs[0]);
    return filters_and_bias(p, param_, outputs_of(p));
  }

  bool keeps_items(size_t, const std::vector<Shape>& inputs) const override {
    return channel_axis(inputs[0]) > 0;
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    return transposed_ ? std::nullopt : window_of_last_axes(problem(input).axes);
  }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    // NCHWc values are images.
    if (transposed_ || inputs[0].rank() != 4 || channel_axis(inputs[0]) != 1) return {};
    return Convolving{planar(problem(inputs[0]))};
  }

  Kernel bind(const Binding& binding) const override {
    Problem p = problem(binding.inputs[0]);
    p.threads = binding.threads;
    return bind_nchw_convolution(p, kernel_for(p, binding.reference_kernels), binding);
  }

 private:
  using Problem = ConvolutionNdProblem;

  size_t channel_axis(const Shape& input) const {
    return input.canonical_axis(param_.axis(),
                                transposed_ ? "deconvolution axis" : "convolution axis");
  }

  int64_t outputs_of(const Problem& p) const { return transposed_ ? p.c_image : p.c_windows; }

  const ConvolutionNdKernel& kernel_for(const Problem& p, bool reference) const {
    if (transposed_) return reference ? kDeconvolutionReference : kDeconvolutionGemm;
    if (reference) return kConvolutionReference;
    return *std::ranges::find_if(convolution_kernels(), [&](const ConvolutionNdKernel& kernel) {
      return kernel.supports(p);
    });
  }

  Problem problem(const Shape& input) const {
    const size_t axis = channel_axis(input);
    const int64_t inputs = input[axis];
    const int64_t outputs = flavor_ == Flavor::kDepthwise ? inputs : param_.num_output();
    const bool per_channel = flavor_ == Flavor::kDepthwise ||
                             (flavor_ == Flavor::kGroupPerChannel && !param_.has_group());
    Problem p;
    p.n = input.product(0, axis);
    p.group = per_channel ? inputs : param_.group();
    if (outputs % p.group != 0)
      throw InputError("num_output ", outputs, " is not a multiple of group ", p.group);
    if (inputs % p.group != 0)
      throw InputError("the ", inputs, " channels of the input (", input,
                       ") are not a multiple of group ", p.group);
    p.c_image = transposed_ ? outputs : inputs;
    p.c_windows = transposed_ ? inputs : outputs;
    p.axes = window_axes(param_, input.rank() - axis - 1);
    for (size_t i = 0; i < p.axes.size(); ++i) {
      WindowAxis& along = p.axes[i];
      (transposed_ ? along.windows : along.image) = input[axis + 1 + i];
      if (transposed_)
        along.image = count_pixels(along);
      else
        along.windows = count_windows(along);
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
  Flavor flavor_;
  bool transposed_;
};

/// Windows of a convolution as channels: channel c and kernel element k yield channel c * K + k.
class Im2col : public OneToOneLayer {
 public:
  explicit Im2col(const caffe::ConvolutionParameter& param) : param_(param) {}

  Shape output_shape(const Shape& input) const override {
    const size_t axis = channel_axis(input);
    const WindowAxes windows = windows_of(input);
    int64_t channels = input[axis];
    std::vector<int64_t> axes = input.axes();
    for (size_t i = 0; i < windows.size(); ++i) {
      // Checked at each step, because the product of many kernel sizes can exceed 64 bits.
      channels = Shape{channels, windows[i].kernel}.elements();
      axes[axis + 1 + i] = windows[i].windows;
    }
    axes[axis] = channels;
    return Shape(std::move(axes));
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    return window_of_last_axes(windows_of(input));
  }

  Kernel bind(const Binding& binding) const override {
    const size_t axis = channel_axis(binding.inputs[0]);
    const WindowAxes axes = windows_of(binding.inputs[0]);
    const int64_t planes = binding.inputs[0].product(0, axis + 1);
    return {"im2col", [axes, planes, threads = binding.threads](const Call& call) {
              const int64_t taps = product_of(axes, &WindowAxis::kernel);
              const int64_t pixels = product_of(axes, &WindowAxis::image);
              const int64_t windows = product_of(axes, &WindowAxis::windows);
              parallel_for(planes * taps, threads, [&](int64_t item, int) {
                gather_pixels(axes, call.inputs[0] + item / taps * pixels, item % taps, 0, windows,
                              call.outputs[0] + item * windows);
              });
            }};
  }

 private:
  size_t channel_axis(const Shape& input) const {
    return input.canonical_axis(param_.axis(), "im2col axis");
  }

  WindowAxes windows_of(const Shape& input) const {
    const size_t axis = channel_axis(input);
    WindowAxes axes = window_axes(param_, input.rank() - axis - 1);
    if (axes.empty())
      throw InputError("expected at least one axis after the channels, found ", input);
    for (size_t i = 0; i < axes.size(); ++i) {
      axes[i].image = input[axis + 1 + i];
      axes[i].windows = count_windows(axes[i]);
    }
    return axes;
  }

  caffe::ConvolutionParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_convolution(const caffe::LayerParameter& param) {
  return std::make_unique<Convolution>(param.convolution_param(), Flavor::kPlain);
}

std::unique_ptr<Layer> make_deconvolution(const caffe::LayerParameter& param) {
  return std::make_unique<Convolution>(param.convolution_param(), Flavor::kTransposed);
}

// The CPU path of this fork equals Convolution, and its models set `group`; its GPU path always
// uses one filter per channel.
std::unique_ptr<Layer> make_depthwise_convolution(const caffe::LayerParameter& param) {
  return std::make_unique<Convolution>(param.convolution_param(), Flavor::kGroupPerChannel);
}

std::unique_ptr<Layer> make_convolution_depthwise(const caffe::LayerParameter& param) {
  return std::make_unique<Convolution>(param.convolution_param(), Flavor::kDepthwise);
}

std::unique_ptr<Layer> make_im2col(const caffe::LayerParameter& param) {
  return std::make_unique<Im2col>(param.convolution_param());
}

}  // namespace revisit::engine
