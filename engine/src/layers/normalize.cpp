#include <algorithm>
#include <cmath>

#include "kernels/channels.h"
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

/// L2 normalization of SSD (Liu et al. 2016), with a trained scale.
class Normalize : public OneToOneLayer {
 public:
  explicit Normalize(const caffe::NormalizeParameter& param) : param_(param) {}

  Shape output_shape(const Shape& input) const override {
    if (input.rank() < 2)
      throw InputError("expected an input of at least 2 axes (n x c x ...), found ", input);
    return input;
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
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
    const float* scale = binding.weights[0].values.data();
    return {"l2-normalize", [problem, scale](const Call& call) {
              normalize(problem, call.inputs[0], scale, call.outputs[0]);
            }};
  }

 private:
  caffe::NormalizeParameter param_;
};

class Mvn : public OneToOneLayer {
 public:
  explicit Mvn(const caffe::MVNParameter& param) : param_(param) {}

  Shape output_shape(const Shape& input) const override {
    if (input.rank() > 4) throw InputError("MVN needs an input of at most 4 axes, found ", input);
    return input;
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

}  // namespace

std::unique_ptr<Layer> make_normalize(const caffe::LayerParameter& param) {
  return std::make_unique<Normalize>(param.norm_param());
}

std::unique_ptr<Layer> make_mvn(const caffe::LayerParameter& param) {
  return std::make_unique<Mvn>(param.mvn_param());
}

}  // namespace revisit::engine
