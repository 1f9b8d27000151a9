#include <algorithm>
#include <cmath>

#include "kernels/channels.h"
#include "kernels/nchw.h"
#include "layers/layers.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

/// Division by the L2 norm, for images `[n][c][pixels]`: y = x / sqrt(eps + sum of x^2) * scale.
/// The sum is over the channels of a pixel, or over the entire image if `across_spatial`. `scale`
/// has one number per channel, or one for all if `channel_shared`.
struct NormalizeProblem {
  int64_t n = 1, c = 1, pixels = 1;
  bool across_spatial = true, channel_shared = true;
  float eps = 1e-10F;
  int threads = 1;
};

constexpr int64_t kPixels = 256;  // per step, so that all their channels stay in cache

void normalize_pixels(const NormalizeProblem& p, const float* in, int64_t count, const float* scale,
                      float* out) {
  float norm[kPixels];
  std::fill_n(norm, count, p.eps);
  for (int64_t c = 0; c < p.c; ++c)
    for (int64_t i = 0; i < count; ++i) norm[i] += in[c * p.pixels + i] * in[c * p.pixels + i];
  for (int64_t i = 0; i < count; ++i) norm[i] = std::sqrt(norm[i]);
  for (int64_t c = 0; c < p.c; ++c)
    for (int64_t i = 0; i < count; ++i)
      out[c * p.pixels + i] = in[c * p.pixels + i] / norm[i] * scale[p.channel_shared ? 0 : c];
}

void normalize_image(const NormalizeProblem& p, const float* in, const float* scale, float* out) {
  double sum = 0;  // in float, later terms of a long sum would be lost
  for (int64_t i = 0; i < p.c * p.pixels; ++i) sum += static_cast<double>(in[i] * in[i]);
  const float inverse = 1 / std::sqrt(static_cast<float>(sum) + p.eps);
  for (int64_t c = 0; c < p.c; ++c)
    for (int64_t i = 0; i < p.pixels; ++i)
      out[c * p.pixels + i] = in[c * p.pixels + i] * inverse * scale[p.channel_shared ? 0 : c];
}

void normalize(const NormalizeProblem& p, const float* input, const float* scale, float* output) {
  if (p.across_spatial) {
    parallel_for(p.n, p.threads, [&](int64_t n, int) {
      normalize_image(p, input + n * p.c * p.pixels, scale, output + n * p.c * p.pixels);
    });
    return;
  }
  const int64_t blocks = (p.pixels + kPixels - 1) / kPixels;
  parallel_for(p.n * blocks, p.threads, [&](int64_t item, int) {
    const int64_t first = item % blocks * kPixels;
    const int64_t offset = item / blocks * p.c * p.pixels + first;
    normalize_pixels(p, input + offset, std::min(kPixels, p.pixels - first), scale,
                     output + offset);
  });
}

/// L2 normalization of SSD (Liu et al. 2016), with a trained scale, or of NormFace, without.
class Normalize : public OneToOneLayer {
 public:
  explicit Normalize(const caffe::NormalizeParameter& param, bool is_scaled = true)
      : param_(param), is_scaled_(is_scaled) {}

  Shape output_shape(const Shape& input) const override {
    if (input.rank() < 2)
      throw InputError("expected an input of at least 2 axes (n x c x ...), found ", input);
    return input;
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    if (!is_scaled_) return {};
    return {param_.channel_shared() ? Shape{} : Shape{inputs[0][1]}};
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }

  std::optional<WindowHw> window(const Shape&) const override {
    return param_.across_spatial() ? std::nullopt : std::optional(WindowHw{});
  }

  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

  Kernel bind(const Binding& binding) const override {
    const Shape& shape = binding.inputs[0];
    NormalizeProblem problem{shape[0], shape[1], shape.product(2, shape.rank())};
    problem.across_spatial = param_.across_spatial();
    problem.channel_shared = param_.channel_shared();
    problem.eps = param_.eps();
    problem.threads = binding.threads;
    static constexpr float kOne = 1;
    const float* scale = is_scaled_ ? binding.weights[0].values.data() : &kOne;
    return {"l2-normalize", [problem, scale](const Call& call) {
              normalize(problem, call.inputs[0], scale, call.outputs[0]);
            }};
  }

 private:
  caffe::NormalizeParameter param_;
  bool is_scaled_;
};

/// NormFace's layer (happynear/caffe-windows, normalize_layer.cpp) has a normalize_type, first in
/// softmax_param, and normalizes each pixel. Any other is SSD's.
std::unique_ptr<Layer> make_normalize(const Parameters& param) {
  const bool early = param.softmax_param().has_normalize_type();
  if (!early && !param.has_normalize_param())
    return std::make_unique<Normalize>(param.norm_param());
  const std::string& type =
      early ? param.softmax_param().normalize_type() : param.normalize_param().normalize_type();
  if (type != "L2") throw UnsupportedError("normalize_type '", type, "' is not supported (L2)");
  caffe::NormalizeParameter of_pixels;
  of_pixels.set_across_spatial(false);
  of_pixels.set_eps(param.has_norm_param() ? param.norm_param().eps() : 1e-6F);
  return std::make_unique<Normalize>(of_pixels, false);
}

class Mvn : public OneToOneLayer {
 public:
  explicit Mvn(const caffe::MVNParameter& param) : param_(param) {}

  Shape output_shape(const Shape& input) const override {
    if (input.rank() > 4) throw InputError("MVN needs an input of at most 4 axes, found ", input);
    std::vector<int64_t> axes = input.axes();
    axes.resize(4, 1);  // as Caffe reshapes it
    return Shape(axes);
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }

  Rounding rounding() const override {
    return param_.normalize_variance() ? Rounding::kAmplified : Rounding::kPassed;
  }

  std::optional<WindowHw> window(const Shape&) const override { return std::nullopt; }

  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

  Kernel bind(const Binding& binding) const override {
    const Shape& shape = binding.inputs[0];
    const size_t axes = std::min<size_t>(param_.across_channels() ? 1 : 2, shape.rank());
    const int64_t groups = shape.product(0, axes), size = shape.product(axes, shape.rank());
    return {"mvn", [groups, size, divide = param_.normalize_variance(), eps = param_.eps(),
                    threads = binding.threads](const Call& call) {
              parallel_for(groups, threads, [&](int64_t group, int) {
                const float* in = call.inputs[0] + group * size;
                const Moments m = moments(in, 1, size, 0);
                ChannelNorm norm{.mean = m.mean};
                if (divide) norm.deviation = std::sqrt(m.variance) + eps;
                normalize(norm, in, size, call.outputs[0] + group * size);
              });
            }};
  }

 private:
  caffe::MVNParameter param_;
};

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

class Softmax : public OneToOneLayer {
 public:
  explicit Softmax(const caffe::SoftmaxParameter& param) : axis_(param.axis()) {
    if (param.has_normalize_type() && param.normalize_type() != "Softmax")
      throw UnsupportedError("normalize_type '", param.normalize_type(), "' is not supported");
  }

  Shape output_shape(const Shape& input) const override {
    only_axis(input);
    return input;
  }

  std::optional<size_t> only_axis(const Shape& input) const override {
    return input.canonical_axis(axis_, "softmax axis");
  }

  Rounding rounding() const override { return Rounding::kCompared; }

  bool allows_in_place() const override { return true; }  // because Caffe copies its input first

  Kernel bind(const Binding& binding) const override {
    const Shape& shape = binding.inputs[0];
    const AxisRuns lines = runs_along(shape, *only_axis(shape));
    if (binding.reference_kernels)
      return {"reference", [lines](const Call& call) {
                softmax_reference(call.inputs[0], lines, call.outputs[0]);
              }};
    return {"softmax", [lines, threads = binding.threads](const Call& call) {
              softmax(call.inputs[0], lines, call.outputs[0], threads);
            }};
  }

 private:
  int axis_;
};

}  // namespace

constinit const LayerEntries kNormalizeLayers = {
    {"LRN", make<Lrn, &Parameters::lrn_param>, "Caffe",
     "local response normalization, across or within channels"},
    {"MVN", make<Mvn, &Parameters::mvn_param>, "Caffe", "mean and variance normalization"},
    {"Normalize", make_normalize, "SSD, NormFace", "L2 normalization, SSD's with a trained scale",
     kTrained},
    {"Softmax", make<Softmax, &Parameters::softmax_param>, "Caffe", "softmax along an axis"},
};

}  // namespace revisit::engine
