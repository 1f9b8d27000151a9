#include <algorithm>
#include <cmath>

#include "kernels/channels.h"
#include "layers/layers.h"

namespace revisit::engine {

Shape trained_operand(const Shape& input, int64_t axis, int64_t num_axes) {
  const size_t first = input.canonical_axis(axis, "axis");
  if (num_axes < -1)
    throw InputError("num_axes must be -1 (all that follow) or more, found ", num_axes);
  const int64_t last =
      num_axes == -1 ? static_cast<int64_t>(input.rank()) : static_cast<int64_t>(first) + num_axes;
  if (last > static_cast<int64_t>(input.rank()))
    throw InputError(num_axes, " axes from axis ", first, " on reach past the input (", input, ")");
  return Shape(std::vector<int64_t>(input.axes().begin() + static_cast<int64_t>(first),
                                    input.axes().begin() + last));
}

AxisRuns lay_over(const Shape& operand, const Shape& input, int64_t axis) {
  const size_t first = operand.rank() == 0 ? 0 : input.canonical_axis(axis, "axis");
  const size_t last = first + operand.rank();
  bool fits = last <= input.rank();
  for (size_t i = 0; fits && i < operand.rank(); ++i) fits = operand[i] == input[first + i];
  if (!fits)
    throw InputError("the second input (", operand, ") does not match the first (", input,
                     ") from axis ", first, " on");
  return {input.product(0, first), operand.elements(), input.product(last, input.rank())};
}

Form channel_affine(const AxisRuns& runs, const Shape& input, const std::vector<float>* scale,
                    const std::vector<float>* shift) {
  if (input.rank() < 2) return {};
  const int64_t channels = input[1];
  const bool one_for_all = runs.size == 1;
  if (!one_for_all &&
      (runs.outer != input[0] || runs.size != channels || runs.elements() != input.elements()))
    return {};
  // Without loaded weights any values will do.
  const auto spread = [&](const std::vector<float>* values, double absent) {
    std::vector<double> result(channels, absent);
    for (int64_t c = 0; values && !values->empty() && c < channels; ++c)
      result[c] = (*values)[one_for_all ? 0 : c];
    return result;
  };
  ChannelAffine affine{spread(scale, 1), spread(shift, 0)};
  return all_finite(affine) ? Form(std::move(affine)) : Form();
}

bool all_finite(const ChannelAffine& affine) {
  const auto finite = [](double x) { return std::isfinite(x); };
  return std::all_of(affine.scale.begin(), affine.scale.end(), finite) &&
         std::all_of(affine.shift.begin(), affine.shift.end(), finite);
}

namespace {

/// input * scale + bias (Scale) or input + bias (Bias). The bias of a Scale is always trained.
class Affine : public Layer {
 public:
  explicit Affine(const caffe::ScaleParameter& param)
      : scales_(true), has_bias_(param.bias_term()), axis_(param.axis()), axes_(param.num_axes()) {}
  explicit Affine(const caffe::BiasParameter& param)
      : scales_(false), has_bias_(true), axis_(param.axis()), axes_(param.num_axes()) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_1_or_2(inputs.size(), "inputs");
    expect_count(n_outputs, 1, "outputs");
    runs(inputs);
    weight_shapes(inputs);
    return {inputs[0]};
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    std::vector<Shape> shapes;
    if (inputs.size() == 1) shapes.push_back(operand(inputs));
    if (scales_ && has_bias_)
      shapes.push_back(trained_operand(
          inputs[0], axis_, inputs.size() == 1 ? axes_ : static_cast<int64_t>(inputs[1].rank())));
    return shapes;
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }

  bool keeps_items(size_t port, const std::vector<Shape>& inputs) const override {
    const bool operand_has_items = inputs[0].canonical_axis(axis_, "axis") == 0;
    return inputs.size() == 1 ? !operand_has_items : port == 0 || operand_has_items;
  }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>& weights) const override {
    if (inputs.size() == 2) return gating(inputs);
    return channel_affine(runs(inputs), inputs[0], scales_ ? &weights.front().values : nullptr,
                          has_bias_ ? &weights.back().values : nullptr);
  }

  Kernel bind(const Binding& binding) const override {
    const bool learned = binding.inputs.size() == 1;
    const float* first = learned ? binding.weights[0].values.data() : nullptr;
    const float* last = scales_ && has_bias_ ? binding.weights.back().values.data() : nullptr;
    return {scales_ ? "scale" : "bias", [runs = runs(binding.inputs), threads = binding.threads,
                                         scales = scales_, learned, first, last](const Call& call) {
              const float* operand = learned ? first : call.inputs[1];
              for_each_run(runs, threads, [&](int64_t channel, int64_t begin, int64_t end) {
                const float value = operand[channel];
                const ChannelNorm norm =
                    scales ? ChannelNorm{.factor = value, .shift = last ? last[channel] : -0.0F}
                           : ChannelNorm{.shift = value};
                normalize(norm, call.inputs[0] + begin, end - begin, call.outputs[0] + begin);
              });
            }};
  }

 private:
  Form gating(const std::vector<Shape>& inputs) const {
    const Shape& x = inputs[0];
    if (!scales_ || has_bias_ || x.rank() < 2) return {};
    const AxisRuns factors = runs(inputs);
    if (factors.outer != 1 || factors.size != x[0] * x[1]) return {};
    return Gating{.x = 0, .factors = 1};
  }

  /// Shape of the second input (a fused addend may follow it) or of the trained operand.
  Shape operand(const std::vector<Shape>& inputs) const {
    return inputs.size() == 1 ? trained_operand(inputs[0], axis_, axes_) : inputs[1];
  }
  AxisRuns runs(const std::vector<Shape>& inputs) const {
    return lay_over(operand(inputs), inputs[0], axis_);
  }

  bool scales_, has_bias_;
  int64_t axis_, axes_;  // first axis of the operand; its number of axes if it is trained
};

class Axpy : public Layer {
 public:
  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 3, "inputs");
    expect_count(n_outputs, 1, "outputs");
    const Shape &a = inputs[0], &x = inputs[1], &y = inputs[2];
    if (x != y) throw InputError("x and y must have the same shape, found ", x, " and ", y);
    if (x.rank() < 2 || a.rank() < 2 || a[0] != x[0] || a[1] != x[1] || a.elements() != x[0] * x[1])
      throw InputError("expected a factor for each image and channel of x (", x,
                       "), that is n x c or n x c x 1 x 1, found ", a);
    return {x};
  }

  std::optional<WindowHw> window(const Shape&) const override { return WindowHw{}; }

  Form form(const std::vector<Shape>&, const std::vector<Tensor>&) const override {
    return Gating{.x = 1, .factors = 0, .addend = 2, .zero_hides = true};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& x = binding.inputs[1];
    const AxisRuns runs{1, x[0] * x[1], x.product(2, x.rank())};
    return {"axpy", [runs, threads = binding.threads](const Call& call) {
              const float *x_data = call.inputs[1], *y_data = call.inputs[2];
              float* out = call.outputs[0];
              for_each_run(runs, threads, [&](int64_t channel, int64_t begin, int64_t end) {
                const float a = call.inputs[0][channel];
                if (a == 0)  // as in BLAS: NaN in x does not propagate
                  std::copy(y_data + begin, y_data + end, out + begin);
                else
                  for (int64_t i = begin; i < end; ++i) out[i] = a * x_data[i] + y_data[i];
              });
            }};
  }
};

/// Synopsys' fork (synopsys-caffe, mul_layer.cpp) with a factor for each channel of an image, in
/// either input; its Mul repeats any axis of size 1.
class Mul : public Layer {
 public:
  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 2, "inputs");
    expect_count(n_outputs, 1, "outputs");
    const size_t map = inputs[0].elements() < inputs[1].elements() ? 1 : 0;
    const Shape &x = inputs[map], &a = inputs[1 - map];
    if (x.rank() != 4 || a != Shape{x[0], x[1], 1, 1})
      throw UnsupportedError("expected n x c x h x w and n x c x 1 x 1, found ", inputs[0], " and ",
                             inputs[1]);
    return {x};
  }

  Kernel bind(const Binding& binding) const override {
    const size_t map = binding.inputs[0] == binding.outputs[0] ? 0 : 1;
    const Shape& x = binding.outputs[0];
    const AxisRuns runs{1, x[0] * x[1], x[2] * x[3]};
    return {"multiply", [runs, map, threads = binding.threads](const Call& call) {
              const float *in = call.inputs[map], *factors = call.inputs[1 - map];
              for_each_run(runs, threads, [&](int64_t channel, int64_t begin, int64_t end) {
                for (int64_t i = begin; i < end; ++i) call.outputs[0][i] = in[i] * factors[channel];
              });
            }};
  }
};

}  // namespace

constinit const LayerEntries kScaleLayers = {
    {"Axpy", make<Axpy>, "SENet", "a x + y, a per channel"},
    {"Bias", make<Affine, &Parameters::bias_param>, "Caffe", "adds a trained or given blob",
     kTrained},
    {"Mul", make<Mul>, "Synopsys", "a x, a per channel"},
    {"Scale", make<Affine, &Parameters::scale_param>, "Caffe",
     "multiplies by a trained or given blob", kTrained},
};

}  // namespace revisit::engine
