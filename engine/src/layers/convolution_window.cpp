#include "layers/convolution.h"

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

void check_outputs_and_groups(const caffe::ConvolutionParameter& param) {
  if (param.num_output() < 1) throw InputError("num_output must be at least 1");
  if (param.group() < 1) throw InputError("group must be at least 1");
  if (param.num_output() % param.group() != 0)
    throw InputError("num_output ", param.num_output(), " is not a multiple of group ",
                     param.group());
}

void check_inputs_and_outputs(const std::vector<Shape>& inputs, size_t n_outputs) {
  if (inputs.empty()) throw InputError("expected at least one input");
  expect_count(n_outputs, inputs.size(), "outputs");
  for (const Shape& input : inputs)
    if (input != inputs[0]) throw InputError("inputs differ in shape: ", inputs[0], " and ", input);
}

Shape with_channels(const Shape& input, size_t channel_axis, int64_t channels,
                    const WindowAxes& axes, int64_t WindowAxis::*pixels) {
  std::vector<int64_t> result(input.axes().begin(),
                              input.axes().begin() + static_cast<int64_t>(channel_axis));
  result.push_back(channels);
  for (const WindowAxis& axis : axes) result.push_back(axis.*pixels);
  return Shape(std::move(result));
}

std::vector<Shape> filters_and_bias(const ConvolutionNdProblem& p,
                                    const caffe::ConvolutionParameter& param, int64_t outputs) {
  std::vector<int64_t> filters{p.c_windows, p.c_image_per_group()};
  for (const WindowAxis& axis : p.axes) filters.push_back(axis.kernel);
  std::vector<Shape> shapes{Shape(std::move(filters))};
  if (param.bias_term()) shapes.push_back(Shape{outputs});
  return shapes;
}

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
  WindowAxes axes(n_axes);
  for (size_t i = 0; i < n_axes; ++i) {
    check(kernel[i], 1, "kernel size");
    check(stride[i], 1, "stride");
    check(pad[i], 0, "pad");
    check(dilation[i], 1, "dilation");
    axes[i].kernel = kernel[i], axes[i].stride = stride[i];
    axes[i].pad = pad[i], axes[i].dilation = dilation[i];
  }
  return axes;
}

int64_t count_windows(const WindowAxis& axis) {
  const int64_t windows = (axis.image + 2 * axis.pad - extent(axis)) / axis.stride + 1;
  if (windows < 1)
    throw InputError("a kernel that spans ", extent(axis), " does not fit into ", axis.image,
                     " + 2 x ", axis.pad, " of the input: the output would be empty");
  return windows;
}

int64_t count_pixels(const WindowAxis& axis) {
  const int64_t pixels = axis.stride * (axis.windows - 1) + extent(axis) - 2 * axis.pad;
  if (pixels < 1)
    throw InputError(axis.windows, " kernels that span ", extent(axis),
                     " cover no more than the padding of 2 x ", axis.pad,
                     ": the output would be empty");
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

}  // namespace revisit::engine
