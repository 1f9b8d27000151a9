#include "layers/convolution.h"

#include <algorithm>

#include "layers/layers.h"
#include "layers/pad_ends.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

/// Accepts a field given once for all spatial axes, once per axis, or not at all.
template <class Field>
std::vector<int64_t> per_axis(const Field& field, size_t axes, int64_t absent, const char* name) {
  const auto given = static_cast<size_t>(field.size());
  if (given != 0 && given != 1 && given != axes)
    throw InputError(name, " is given ", given, " times; expected once, or once for each of ", axes,
                     " spatial axes");
  std::vector<int64_t> values(axes, absent);
  for (size_t i = 0; i < axes && given > 0; ++i)
    values[i] = field.Get(static_cast<int>(given == 1 ? 0 : i));
  return values;
}

/// Resolves a field that can also be given as _h and _w (2-D only, then not repeated).
template <class Field>
std::vector<int64_t> per_axis_or_hw(const Field& field, bool has_h, bool has_w, int64_t h,
                                    int64_t w, size_t axes, int64_t absent, const char* name) {
  if (!has_h && !has_w) return per_axis(field, axes, absent, name);
  if (axes != 2)
    throw InputError(name, "_h and ", name, "_w need 2 spatial axes, the input has ", axes);
  if (field.size() > 0)
    throw InputError("give ", name, " or ", name, "_h and ", name, "_w, not both");
  return {h, w};
}

/// Checks Caffe's range of int, which also prevents overflow of products of two.
void check(int64_t value, int64_t least, const char* what) {
  if (value < least) throw InputError(what, " must be at least ", least);
  if (value > INT32_MAX) throw InputError(what, " is too large: ", value);
}

int64_t extent(const WindowAxis& axis) {
  return axis.dilation * (axis.kernel - 1) + 1;
}

}  // namespace

WindowAxes window_axes(const caffe::ConvolutionParameter& param, size_t n_axes) {
  if (n_axes > 0 && param.kernel_size_size() == 0 && !param.has_kernel_h() && !param.has_kernel_w())
    throw InputError("kernel size must be given");
  if (param.has_hole() || param.has_hole_h() || param.has_hole_w())  // not upgraded: contradictory
    throw InputError("give one of dilation, hole, and both hole_h and hole_w");
  const auto kernel =
      per_axis_or_hw(param.kernel_size(), param.has_kernel_h(), param.has_kernel_w(),
                     param.kernel_h(), param.kernel_w(), n_axes, 0, "kernel");
  const auto stride = per_axis_or_hw(param.stride(), param.has_stride_h(), param.has_stride_w(),
                                     param.stride_h(), param.stride_w(), n_axes, 1, "stride");
  const auto pad = per_axis_or_hw(param.pad(), param.has_pad_h(), param.has_pad_w(), param.pad_h(),
                                  param.pad_w(), n_axes, 0, "pad");
  const auto dilation = per_axis(param.dilation(), n_axes, 1, "dilation");
  const auto ends = pad_ends(param);
  if (ends && n_axes != 2)
    throw InputError("pad_b and pad_r need 2 spatial axes, the input has ", n_axes);
  WindowAxes axes(n_axes);
  for (size_t i = 0; i < n_axes; ++i) {
    check(kernel[i], 1, "kernel size");
    check(stride[i], 1, "stride");
    check(pad[i], 0, "pad");
    check(dilation[i], 1, "dilation");
    axes[i].kernel = kernel[i], axes[i].stride = stride[i];
    axes[i].pad = pad[i], axes[i].dilation = dilation[i];
    if (!ends) continue;
    check((*ends)[i], 0, "pad");
    axes[i].end_surplus = (*ends)[i] - pad[i];
  }
  return axes;
}

namespace {

/// Divides toward zero (docs/reference/LAYERS.md point 3), so a kernel that exceeds the padded
/// image by less than the stride yields one window. Throws InputError if none fits.
int64_t count_windows(const WindowAxis& axis) {
  const int64_t windows = (axis.padded() - extent(axis)) / axis.stride + 1;
  if (windows < 1)
    throw InputError("a kernel that spans ", extent(axis), " does not fit into ", axis.image, " + ",
                     axis.padded() - axis.image, " of the input: the output would be empty");
  return windows;
}

/// Excludes the padding. Throws InputError if no pixel is left.
int64_t count_pixels(const WindowAxis& axis) {
  const int64_t padding = 2 * axis.pad + axis.end_surplus;
  const int64_t pixels = axis.stride * (axis.windows - 1) + extent(axis) - padding;
  if (pixels < 1)
    throw InputError(axis.windows, " kernels that span ", extent(axis),
                     " cover no more than the padding of ", padding, ": the output would be empty");
  return pixels;
}

std::optional<WindowHw> window_of_last_axes(const WindowAxes& axes) {
  if (axes.empty()) return std::nullopt;
  const auto along = [](const WindowAxis& axis) {
    return Window{extent(axis), axis.stride, axis.pad};
  };
  const size_t n = axes.size();
  return WindowHw{n > 1 ? along(axes[n - 2]) : Window{}, along(axes[n - 1])};
}

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
    if (flavor_ == Flavor::kDepthwise) return;
    if (param.num_output() < 1) throw InputError("num_output must be at least 1");
    if (param.group() < 1) throw InputError("group must be at least 1");
    if (param.num_output() % param.group() != 0)
      throw InputError("num_output ", param.num_output(), " is not a multiple of group ",
                       param.group());
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_any(inputs.size(), "input");
    expect_count(n_outputs, inputs.size(), "outputs");
    for (const Shape& input : inputs)
      if (input != inputs[0])
        throw InputError("inputs differ in shape: ", inputs[0], " and ", input);
    const Problem p = problem(inputs[0]);
    const auto begin = inputs[0].axes().begin();
    std::vector<int64_t> output(begin, begin + static_cast<int64_t>(channel_axis(inputs[0])));
    output.push_back(outputs_of(p));
    for (const WindowAxis& axis : p.axes) output.push_back(transposed_ ? axis.image : axis.windows);
    return std::vector<Shape>(n_outputs, Shape(std::move(output)));
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    const Problem p = problem(inputs[0]);
    std::vector<int64_t> filters{p.c_windows, p.c_image_per_group()};
    for (const WindowAxis& axis : p.axes) filters.push_back(axis.kernel);
    std::vector<Shape> shapes{Shape(std::move(filters))};
    if (param_.bias_term()) shapes.push_back(Shape{outputs_of(p)});
    return shapes;
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

constinit const LayerEntries kConvolutionLayers = {
    {"Convolution", make<Convolution, &Parameters::convolution_param, Flavor::kPlain>, "Caffe",
     "1-D, 2-D, 3-D and more; group, stride, pad, dilation", kTrained},
    {"ConvolutionDepthwise", make<Convolution, &Parameters::convolution_param, Flavor::kDepthwise>,
     "forks", "convolution, one group per channel", kTrained},
    {"Deconvolution", make<Convolution, &Parameters::convolution_param, Flavor::kTransposed>,
     "Caffe", "transposed convolution", kTrained},
    // The CPU path of this fork equals Convolution, and its models set `group`; its GPU path always
    // uses one filter per channel.
    {"DepthwiseConvolution",
     make<Convolution, &Parameters::convolution_param, Flavor::kGroupPerChannel>, "forks",
     "convolution, one group per channel", kTrained},
    {"Im2col", make<Im2col, &Parameters::convolution_param>, "Caffe", "windows as columns"},
};

}  // namespace revisit::engine
