#include "kernels/convolution.h"

#include <algorithm>

#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// One of the fields that repeat per spatial axis: once for all axes, once per axis, or not at all.
template <class Field>
std::vector<int64_t> per_axis(const Field& field, size_t axes, int64_t absent, const char* name) {
  const auto given = static_cast<size_t>(field.size());
  if (given != 0 && given != 1 && given != axes)
    throw InputError(str(name, " is given ", given, " times; expected once, or once for each of ",
                         axes, " spatial axes"));
  std::vector<int64_t> values(axes, absent);
  for (size_t i = 0; i < axes && given > 0; ++i)
    values[i] = field.Get(static_cast<int>(given == 1 ? 0 : i));
  return values;
}

/// A field that can also be given as _h and _w (2-D only, and then not repeated as well).
template <class Field>
std::vector<int64_t> per_axis_or_hw(const Field& field, bool has_h, bool has_w, int64_t h,
                                    int64_t w, size_t axes, int64_t absent, const char* name) {
  if (!has_h && !has_w) return per_axis(field, axes, absent, name);
  if (axes != 2)
    throw InputError(str(name, "_h and ", name, "_w need 2 spatial axes, the input has ", axes));
  if (field.size() > 0)
    throw InputError(str("give ", name, " or ", name, "_h and ", name, "_w, not both"));
  return {h, w};
}

/// The parameters resolved for an input.
struct Geometry {
  std::vector<int64_t> kernel, stride, pad, dilation;
};

class Convolution : public Layer {
 public:
  explicit Convolution(const caffe::ConvolutionParameter& param) : param_(param) {
    if (param.num_output() < 1) throw InputError("num_output must be at least 1");
    if (param.group() < 1) throw InputError("group must be at least 1");
    if (param.num_output() % param.group() != 0)
      throw InputError(
          str("num_output ", param.num_output(), " is not a multiple of group ", param.group()));
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    if (inputs.empty()) throw InputError("expected at least one input");
    expect_count(n_outputs, inputs.size(), "outputs");
    std::vector<Shape> outputs;
    for (const Shape& input : inputs) {
      if (input != inputs[0])
        throw InputError(str("inputs differ in shape: ", inputs[0], " and ", input));
      outputs.push_back(infer_one(input));
    }
    return outputs;
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    const size_t axis = channel_axis(inputs[0]);
    const Geometry geometry = resolve(inputs[0].rank() - axis - 1);
    std::vector<int64_t> weight{param_.num_output(), inputs[0][axis] / param_.group()};
    weight.insert(weight.end(), geometry.kernel.begin(), geometry.kernel.end());
    std::vector<Shape> shapes{Shape(std::move(weight))};
    if (param_.bias_term()) shapes.push_back(Shape{param_.num_output()});
    return shapes;
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    const size_t axes = input.rank() - channel_axis(input) - 1;
    if (axes > 2) return std::nullopt;
    const Geometry g = resolve(axes);
    const auto along = [&](size_t i) {
      return Window{g.dilation[i] * (g.kernel[i] - 1) + 1, g.stride[i], g.pad[i]};
    };
    return axes == 1 ? WindowHw{{}, along(0)} : WindowHw{along(0), along(1)};
  }

  Kernel bind(const Binding& binding) const override {
    const ConvolutionProblem problem =
        problem_for(binding.inputs[0], binding.outputs[0], binding.threads);
    const auto kernels = convolution_kernels();
    const ConvolutionKernel& chosen =
        binding.reference_kernels
            ? kernels.back()
            : *std::find_if(kernels.begin(), kernels.end(), [&](const ConvolutionKernel& kernel) {
                return kernel.supports(problem);
              });
    const float* weights = binding.weights[0].values.data();
    const float* bias = param_.bias_term() ? binding.weights[1].values.data() : nullptr;
    const auto n_inputs = static_cast<int64_t>(binding.inputs.size());
    return {chosen.name,
            [problem, &chosen, weights, bias](const Call& call) {
              for (size_t i = 0; i < call.inputs.size(); ++i)
                chosen.run(problem, call.inputs[i], weights, bias, call.outputs[i], call.scratch);
            },
            chosen.scratch_floats(problem), n_inputs * problem.macs()};
  }

 private:
  size_t channel_axis(const Shape& input) const {
    return input.canonical_axis(param_.axis(), "convolution axis");
  }

  Geometry resolve(size_t axes) const {
    if (axes < 1 || axes > 2)
      throw UnsupportedError(
          str("a convolution over ", axes, " spatial axes is not supported (1 or 2 are)"));
    Geometry g;
    g.kernel = per_axis_or_hw(param_.kernel_size(), param_.has_kernel_h(), param_.has_kernel_w(),
                              param_.kernel_h(), param_.kernel_w(), axes, 0, "kernel");
    g.stride = per_axis_or_hw(param_.stride(), param_.has_stride_h(), param_.has_stride_w(),
                              param_.stride_h(), param_.stride_w(), axes, 1, "stride");
    g.pad = per_axis_or_hw(param_.pad(), param_.has_pad_h(), param_.has_pad_w(), param_.pad_h(),
                           param_.pad_w(), axes, 0, "pad");
    g.dilation = per_axis(param_.dilation(), axes, 1, "dilation");
    for (size_t i = 0; i < axes; ++i) {
      if (g.kernel[i] < 1) throw InputError("kernel size must be given and at least 1");
      if (g.stride[i] < 1) throw InputError("stride must be at least 1");
      if (g.dilation[i] < 1) throw InputError("dilation must be at least 1");
    }
    return g;
  }

  Shape infer_one(const Shape& input) const {
    const size_t axis = channel_axis(input);
    const Geometry g = resolve(input.rank() - axis - 1);
    if (input[axis] % param_.group() != 0)
      throw InputError(str("the ", input[axis], " channels of the input (", input,
                           ") are not a multiple of group ", param_.group()));
    std::vector<int64_t> axes(input.axes().begin(),
                              input.axes().begin() + static_cast<int64_t>(axis));
    axes.push_back(param_.num_output());
    for (size_t i = 0; i < g.kernel.size(); ++i) {
      const int64_t size = input[axis + 1 + i];
      const int64_t extent = g.dilation[i] * (g.kernel[i] - 1) + 1;
      // Integer division truncates toward zero (SEMANTICS section 3): a kernel that is larger than
      // the padded input by less than the stride still gives one output.
      const int64_t out = (size + 2 * g.pad[i] - extent) / g.stride[i] + 1;
      if (out < 1)
        throw InputError(str("a kernel that spans ", extent, " does not fit into ", size, " + 2 x ",
                             g.pad[i], " of the input (", input, "): the output would be empty"));
      axes.push_back(out);
    }
    return Shape(std::move(axes));
  }

  /// 1-D problems run as 2-D ones of height 1.
  ConvolutionProblem problem_for(const Shape& input, const Shape& output, int threads) const {
    const size_t axis = channel_axis(input);
    Geometry g = resolve(input.rank() - axis - 1);
    const bool flat = g.kernel.size() == 1;
    const auto widen = [&](std::vector<int64_t>& values, int64_t neutral) {
      if (flat) values.insert(values.begin(), neutral);
    };
    widen(g.kernel, 1), widen(g.stride, 1), widen(g.pad, 0), widen(g.dilation, 1);
    ConvolutionProblem p;
    p.n = input.product(0, axis);
    p.c_in = input[axis];
    p.h = flat ? 1 : input[axis + 1];
    p.w = input[input.rank() - 1];
    p.c_out = output[axis];
    p.out_h = flat ? 1 : output[axis + 1];
    p.out_w = output[output.rank() - 1];
    p.kernel_h = g.kernel[0], p.kernel_w = g.kernel[1];
    p.stride_h = g.stride[0], p.stride_w = g.stride[1];
    p.pad_h = g.pad[0], p.pad_w = g.pad[1];
    p.dilation_h = g.dilation[0], p.dilation_w = g.dilation[1];
    p.group = param_.group();
    p.threads = threads;
    return p;
  }

  caffe::ConvolutionParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_convolution(const caffe::LayerParameter& param) {
  return std::make_unique<Convolution>(param.convolution_param());
}

}  // namespace revisit::engine
