#include <algorithm>
#include <cmath>
#include <cstring>

#include "kernels/channels.h"
#include "kernels/epilogue.h"
#include "layers/layers.h"
#include "revisit/base/hash.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

class ElementwiseLayer : public OneToOneLayer {
 public:
  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }
  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

 protected:
  /// Kernel of `change(in, count, out)` for any part of the values.
  template <class Change>
  static Kernel on_ranges(const char* name, const Binding& binding, Change change) {
    return {name, [elements = binding.inputs[0].elements(), threads = binding.threads,
                   change](const Call& call) {
              parallel_ranges(elements, kParallelGrain, threads, [&](int64_t begin, int64_t end) {
                change(call.inputs[0] + begin, end - begin, call.outputs[0] + begin);
              });
            }};
  }
};

/// Uses Caffe's own expressions where they determine NaN and infinity or round in double. For
/// activations they are the reference of the SIMD kernels.
template <class Function>
class Elementwise : public ElementwiseLayer {
 public:
  Elementwise(const char* name, Function function, bool in_place, Form form)
      : name_(name), function_(std::move(function)), in_place_(in_place), form_(std::move(form)) {}

  bool allows_in_place() const override { return in_place_; }
  Rounding rounding() const override {
    const auto* activating = std::get_if<Activating>(&form_);
    const bool relu = activating && activating->epilogue.activation == Epilogue::Activation::kRelu;
    return relu ? Rounding::kNone : Rounding::kPassed;
  }
  Form form(const std::vector<Shape>&, const std::vector<Tensor>&) const override { return form_; }

  Kernel bind(const Binding& binding) const override {
    const auto* activating = std::get_if<Activating>(&form_);
    if (activating && !binding.reference_kernels)
      return on_ranges(
          name_, binding,
          [epilogue = activating->epilogue](const float* in, int64_t count, float* out) {
            activate(epilogue, count, in, out);
          });
    return on_ranges(activating ? "reference" : name_, binding,
                     [function = function_](const float* in, int64_t count, float* out) {
                       std::transform(in, in + count, out, function);
                     });
  }

 private:
  const char* name_;
  Function function_;
  bool in_place_;
  Form form_;
};

template <class Function>
std::unique_ptr<Layer> elementwise(const char* name, Function function, bool in_place = true,
                                   Form form = {}) {
  return std::make_unique<Elementwise<Function>>(name, std::move(function), in_place,
                                                 std::move(form));
}

/// Is not fused if the slope is not finite, because fused kernels keep positive values unchanged.
template <class Function>
std::unique_ptr<Layer> activation(const char* name, Function function, const Epilogue& epilogue) {
  if (!std::isfinite(epilogue.slope)) return elementwise(name, std::move(function));
  return elementwise(name, std::move(function), true, Activating{epilogue});
}

float sigmoid(float x) {
  return static_cast<float>(0.5 * std::tanh(0.5 * static_cast<double>(x)) + 0.5);
}

/// Caffe skips a shift of 0, which would turn -0 into +0. Adding -0 is the identity.
float neutral_if_zero(float shift) {
  return shift == 0 ? -0.0F : shift;
}

/// Power with exponent 1, equal to a Scale with one number for all channels.
class PowerOfOne : public ElementwiseLayer {
 public:
  PowerOfOne(float scale, float shift) : scale_(scale), shift_(shift) {}

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    const std::vector<float> scale{scale_}, shift{shift_};
    return channel_affine({1, 1, inputs[0].elements()}, inputs[0], &scale, &shift);
  }

  Kernel bind(const Binding& binding) const override {
    const ChannelNorm norm{.factor = scale_, .shift = shift_};
    return on_ranges("affine", binding, [norm](const float* in, int64_t count, float* out) {
      normalize(norm, in, count, out);
    });
  }

 private:
  float scale_, shift_;
};

/// ln(base) of Exp and Log, where a base of -1 stands for e.
float log_of_base(float base) {
  if (base == -1) return 1;
  const float result = base > 0 ? std::log(base) : NAN;
  if (!std::isfinite(result)) throw InputError("base must be positive (or -1 for e), found ", base);
  return result;
}

class PReLU : public ElementwiseLayer {
 public:
  explicit PReLU(const caffe::PReLUParameter& param) : shared_(param.channel_shared()) {}

  // Volumes are V-Net's; the original Caffe allows at most 4 axes.
  Shape output_shape(const Shape& input) const override {
    expect_channels(input, "PReLU");
    return input;
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    return {shared_ ? Shape{} : Shape{inputs[0][1]}};
  }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>& weights) const override {
    if (inputs[0].rank() > 4) return {};
    std::vector<float> slopes = weights[0].values;
    // Fused kernels keep positive values unchanged; for other slopes bind() has Caffe's expression.
    if (!std::ranges::all_of(slopes, [](float slope) { return std::isfinite(slope); })) return {};
    slopes.resize(inputs[0][1], shared_ && !slopes.empty() ? slopes[0] : 0);
    auto held =
        std::make_shared<const AlignedFloats>(padded(slopes, padded_channels(inputs[0][1])));
    const float* const data = held->data();
    return Activating{{.activation = Epilogue::Activation::kPrelu, .slopes = data},
                      std::move(held)};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& shape = binding.inputs[0];
    const AxisRuns runs = shared_ ? AxisRuns{.inner = shape.elements()} : runs_along(shape, 1);
    return {"prelu", [runs, slopes = binding.weights[0].values.data(),
                      threads = binding.threads](const Call& call) {
              const float* in = call.inputs[0];
              float* out = call.outputs[0];
              for_each_run(runs, threads, [&](int64_t channel, int64_t begin, int64_t end) {
                const float slope = slopes[channel];
                for (int64_t i = begin; i < end; ++i) out[i] = leaky_relu(in[i], slope);
              });
            }};
  }

 private:
  bool shared_;
};

/// Dropout of Bayesian SegNet at inference, to sample from the posterior: each pass has its own
/// mask. It depends on the layer's name, the seed and the index of the pass only.
class SampledDropout : public OneToOneLayer {
 public:
  explicit SampledDropout(const caffe::LayerParameter& param)
      : ratio_(param.dropout_param().dropout_ratio()),
        factor_(param.dropout_param().scale_train() ? 1 / (1 - ratio_) : 1) {
    if (!(ratio_ >= 0 && ratio_ < 1))
      throw InputError("dropout_ratio must be at least 0 and below 1, found ", ratio_);
    for (const char c : param.name()) key_ = fnv1a(key_, static_cast<unsigned char>(c));
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }

  Kernel bind(const Binding& binding) const override {
    const int64_t elements = binding.inputs[0].elements();
    const auto drop = [elements, threads = binding.threads, ratio = ratio_, factor = factor_,
                       key = mixed_bits(key_ + binding.seed)](const Call& call) {
      int64_t pass = 0;
      std::memcpy(&pass, call.state, sizeof pass);
      const auto first = static_cast<uint64_t>(pass * elements);
      parallel_ranges(elements, kParallelGrain, threads, [&](int64_t begin, int64_t end) {
        for (int64_t i = begin; i < end; ++i) {
          const bool keeps = unit_number(key, first + static_cast<uint64_t>(i)) >= ratio;
          call.outputs[0][i] = keeps ? call.inputs[0][i] * factor : 0;
        }
      });
      ++pass;
      std::memcpy(call.state, &pass, sizeof pass);
    };
    return {.name = "dropout", .run = drop, .state = Bytes(sizeof(int64_t))};
  }

 private:
  float ratio_, factor_;
  uint64_t key_ = kFnv1aStart;
};

constexpr int64_t kChunk = 1024;  // elements per step, which fit the L1 cache

using Inputs = std::vector<const float*>;

void multiply(const Inputs& inputs, int64_t begin, int64_t count, float* result) {
  std::copy_n(inputs[0] + begin, count, result);
  for (size_t k = 1; k < inputs.size(); ++k)
    for (int64_t i = 0; i < count; ++i) result[i] *= inputs[k][begin + i];
}

void add(const Inputs& inputs, const std::vector<float>& coefficients, int64_t begin, int64_t count,
         float* result) {
  std::fill_n(result, count, 0.0F);
  for (size_t k = 0; k < inputs.size(); ++k) {
    const float coefficient = coefficients[k];
    if (coefficient == 0) continue;  // as in BLAS: NaN does not propagate
    for (int64_t i = 0; i < count; ++i) result[i] += coefficient * inputs[k][begin + i];
  }
}

/// Caffe's comparisons: if either of the first two inputs is NaN, the second remains.
void maximum(const Inputs& inputs, int64_t begin, int64_t count, float* result) {
  for (int64_t i = 0; i < count; ++i) {
    const float a = inputs[0][begin + i], b = inputs[1][begin + i];
    result[i] = a > b ? a : b;
  }
  for (size_t k = 2; k < inputs.size(); ++k)
    for (int64_t i = 0; i < count; ++i)
      if (inputs[k][begin + i] > result[i]) result[i] = inputs[k][begin + i];
}

class Eltwise : public Layer {
 public:
  using Param = caffe::EltwiseParameter;

  explicit Eltwise(const Param& param) : param_(param) {
    if (param.operation() == Param::PROD && param.coeff_size() > 0)
      throw InputError("coeff is for the operation SUM, not for PROD");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    if (inputs.size() < 2) throw InputError("expected at least 2 inputs, found ", inputs.size());
    expect_count(n_outputs, 1, "outputs");
    const auto n_coefficients = static_cast<size_t>(param_.coeff_size());
    if (n_coefficients != 0 && n_coefficients != inputs.size())
      throw InputError("expected one coeff for each of ", inputs.size(), " inputs, found ",
                       n_coefficients);
    for (const Shape& input : inputs)
      if (input != inputs[0])
        throw InputError("inputs must have the same shape, found ", inputs[0], " and ", input);
    return {inputs[0]};
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }
  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    using Operation = BlockedEltwise::Operation;
    if (param_.operation() == Param::PROD) return Combining{Operation::kProduct, {}};
    if (param_.operation() == Param::MAX) return Combining{Operation::kMaximum, {}};
    return Combining{Operation::kSum, coefficients(inputs.size())};
  }

  /// False for sum and maximum, because Caffe fills their output before it reads the inputs.
  bool allows_in_place() const override { return param_.operation() == Param::PROD; }

  Kernel bind(const Binding& binding) const override {
    const int64_t elements = binding.outputs[0].elements();
    const int threads = binding.threads;
    if (param_.operation() == Param::PROD) return kernel("product", elements, threads, multiply);
    if (param_.operation() == Param::MAX) return kernel("maximum", elements, threads, maximum);
    return kernel("sum", elements, threads,
                  [coefficients = coefficients(binding.inputs.size())](
                      const Inputs& inputs, int64_t begin, int64_t count, float* result) {
                    add(inputs, coefficients, begin, count, result);
                  });
  }

 private:
  std::vector<float> coefficients(size_t n_inputs) const {
    std::vector<float> result(param_.coeff().begin(), param_.coeff().end());
    result.resize(n_inputs, 1);
    return result;
  }

  /// Reads a chunk of all inputs before it writes the output, which may share their memory.
  template <class Combine>
  static Kernel kernel(const char* name, int64_t elements, int threads, Combine combine) {
    return {name, [elements, threads, combine = std::move(combine)](const Call& call) {
              parallel_ranges(elements, kChunk, threads, [&](int64_t begin, int64_t end) {
                float result[kChunk];
                combine(call.inputs, begin, end - begin, result);
                std::copy_n(result, end - begin, call.outputs[0] + begin);
              });
            }};
  }

  Param param_;
};

std::unique_ptr<Layer> make_abs_val(const caffe::LayerParameter&) {
  constexpr bool kInPlace = false;  // the only elementwise function that Caffe rejects in place
  return elementwise(
      "abs", [](float x) { return std::abs(x); }, kInPlace);
}

std::unique_ptr<Layer> make_bnll(const caffe::LayerParameter&) {
  return activation("bnll",
                    [](float x) {
                      return static_cast<float>(x > 0 ? x + std::log(1.0 + std::exp(-x))
                                                      : std::log(1.0 + std::exp(x)));
                    },
                    {.activation = Epilogue::Activation::kBnll});
}

std::unique_ptr<Layer> make_clip(const caffe::LayerParameter& param) {
  const float low = param.clip_param().min(), high = param.clip_param().max();
  return elementwise("clip", [low, high](float x) { return std::max(low, std::min(x, high)); });
}

std::unique_ptr<Layer> make_elu(const caffe::LayerParameter& param) {
  const float alpha = param.elu_param().alpha();
  return activation(
      "elu",
      [alpha](float x) { return std::max(x, 0.0F) + alpha * (std::exp(std::min(x, 0.0F)) - 1); },
      {.activation = Epilogue::Activation::kElu, .slope = alpha});
}

std::unique_ptr<Layer> make_exp(const caffe::LayerParameter& param) {
  const caffe::ExpParameter& exp = param.exp_param();
  const float inner = log_of_base(exp.base()) * exp.scale();
  const float outer = exp.base() == -1 ? std::exp(exp.shift()) : std::pow(exp.base(), exp.shift());
  return elementwise("exp", [inner, outer](float x) { return std::exp(inner * x) * outer; });
}

std::unique_ptr<Layer> make_hard_swish(const caffe::LayerParameter&) {
  return elementwise("hard-swish", [](float x) {
    return static_cast<float>(x * std::min(std::max(x + 3.0, 0.0), 6.0) / 6.0);
  });
}

std::unique_ptr<Layer> make_log(const caffe::LayerParameter& param) {
  const caffe::LogParameter& log = param.log_param();
  const float scale = log.scale(), shift = neutral_if_zero(log.shift());
  const float outer = 1 / log_of_base(log.base());
  if (!std::isfinite(outer)) throw InputError("base must not be 1");
  return elementwise(
      "log", [scale, shift, outer](float x) { return std::log(x * scale + shift) * outer; });
}

std::unique_ptr<Layer> make_mish(const caffe::LayerParameter&) {
  return activation("mish",
                    [](double x) {
                      const double e = std::exp(-std::abs(x));
                      const double n = x < 0 ? e * (e + 2) : 1 + 2 * e;
                      return static_cast<float>(x * (n / (n + (x < 0 ? 2 : 2 * e * e))));
                    },
                    {.activation = Epilogue::Activation::kMish});
}

std::unique_ptr<Layer> make_power(const caffe::LayerParameter& param) {
  const caffe::PowerParameter& p = param.power_param();
  const float power = p.power(), scale = p.scale(), shift = neutral_if_zero(p.shift());
  if (power * scale == 0) {
    // Caffe then ignores the input, so NaN does not propagate.
    const float value = power == 0 ? 1 : std::pow(p.shift(), power);
    return elementwise("constant", [value](float) { return value; });
  }
  if (power == 1) return std::make_unique<PowerOfOne>(scale, shift);
  return elementwise("power", [=](float x) { return std::pow(x * scale + shift, power); });
}

std::unique_ptr<Layer> make_relu(const caffe::LayerParameter& param) {
  const float slope = param.relu_param().negative_slope();
  return activation("relu", [slope](float x) { return leaky_relu(x, slope); },
                    {.activation = Epilogue::Activation::kRelu, .slope = slope});
}

std::unique_ptr<Layer> make_relu6(const caffe::LayerParameter& param) {
  // Some forks have the slope in relu_param.
  const float slope = param.has_relu6_param() ? param.relu6_param().negative_slope()
                                              : param.relu_param().negative_slope();
  const auto relu6 = [slope](float x) {
    return std::min(std::max(x, 0.0F), 6.0F) + slope * std::min(x, 0.0F);
  };
  if (slope != 0) return elementwise("relu6", relu6);
  return activation("relu6", relu6,
                    {.activation = Epilogue::Activation::kClip, .low = 0, .high = 6});
}

std::unique_ptr<Layer> make_sigmoid(const caffe::LayerParameter&) {
  return activation("sigmoid", sigmoid, {.activation = Epilogue::Activation::kSigmoid});
}

std::unique_ptr<Layer> make_swish(const caffe::LayerParameter& param) {
  const float beta = param.swish_param().beta();
  return activation("swish", [beta](float x) { return x * sigmoid(beta * x); },
                    {.activation = Epilogue::Activation::kSwish, .slope = beta});
}

std::unique_ptr<Layer> make_tanh(const caffe::LayerParameter&) {
  return activation("tanh", [](float x) { return std::tanh(x); },
                    {.activation = Epilogue::Activation::kTanh});
}

std::unique_ptr<Layer> make_threshold(const caffe::LayerParameter& param) {
  const float threshold = param.threshold_param().threshold();
  return elementwise("threshold", [threshold](float x) { return x > threshold ? 1.0F : 0.0F; });
}

std::unique_ptr<Layer> make_dropout(const caffe::LayerParameter& param) {
  const caffe::DropoutParameter& dropout = param.dropout_param();
  if (dropout.sample_weights_test()) return std::make_unique<SampledDropout>(param);
  if (dropout.scale_train()) return make_identity(param);
  // Fast R-CNN's training drops values without rescaling, so inference has to rescale.
  caffe::LayerParameter scaling;
  scaling.mutable_power_param()->set_scale(1 / (1 / (1 - dropout.dropout_ratio())));
  return make_power(scaling);
}

}  // namespace

constinit const LayerEntries kElementwiseLayers = {
    {"AbsVal", make_abs_val, "Caffe", "absolute value"},
    {"BNLL", make_bnll, "Caffe", "log(1 + exp x)"},
    {"Clip", make_clip, "Caffe", "limits to [min, max]"},
    {"Dropout", make_dropout, "Caffe",
     "identity at inference; with options of forks, scales or drops"},
    {"Eltwise", make<Eltwise, &Parameters::eltwise_param>, "Caffe",
     "product, weighted sum, maximum"},
    {"ELU", make_elu, "Caffe", "exponential linear unit"},
    {"Exp", make_exp, "Caffe", "base ^ (shift + scale x)"},
    {"HardSwish", make_hard_swish, "Synopsys", "x min(max(x + 3, 0), 6) / 6"},
    {"Log", make_log, "Caffe", "log_base(shift + scale x)"},
    {"Mish", make_mish, "YOLOv4", "x tanh(ln(1 + exp x))"},
    {"Power", make_power, "Caffe", "(shift + scale x) ^ power"},
    {"PReLU", make<PReLU, &Parameters::prelu_param>, "Caffe", "leaky ReLU with trained slopes",
     kTrained},
    {"ReLU", make_relu, "Caffe", "max(x, 0), or leaky"},
    {"ReLU6", make_relu6, "forks", "min(max(x, 0), 6)"},
    {"Sigmoid", make_sigmoid, "Caffe", "1 / (1 + exp(-x))"},
    {"Swish", make_swish, "Caffe", "x sigmoid(beta x)"},
    {"TanH", make_tanh, "Caffe", "hyperbolic tangent"},
    {"Threshold", make_threshold, "Caffe", "1 above a threshold, else 0"},
};

}  // namespace revisit::engine
