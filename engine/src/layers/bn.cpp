#include <cmath>

#include "kernels/channel_runs.h"
#include "kernels/moments.h"
#include "layers/broadcast.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

using Bn = caffe::BNParameter;

constexpr float kEpsOfSegNet = 1e-9F;

/// What is done to one channel: (x - mean) * factor + shift.
struct ChannelNorm {
  float mean = 0, factor = 1, shift = 0;
};

/// Batch normalisation with a learned scale and shift. Two forks have a layer of this name.
/// PSPNet's keeps mean and variance in blobs of their own. SegNet's has scale and shift only: with
/// INFERENCE they hold the statistics, too; with LEARN those of the batch at hand are taken.
class BnLayer : public OneToOneLayer {
 public:
  explicit BnLayer(const Bn& param)
      : of_segnet_(param.has_scale_filler() || param.has_shift_filler() || param.has_bn_mode()),
        of_batch_(of_segnet_ && param.bn_mode() == Bn::LEARN),
        eps_(param.eps()) {
    const bool of_pspnet = param.has_slope_filler() || param.has_bias_filler() ||
                           param.has_frozen() || param.has_momentum() || param.has_eps();
    if (of_segnet_ && of_pspnet)
      throw InputError(
          "bn_param has fields of SegNet's BN (scale_filler, shift_filler, bn_mode) and of "
          "PSPNet's "
          "(slope_filler, bias_filler, frozen, momentum, eps), which have other weights");
  }

  Shape output_shape(const Shape& input) const override {
    if (input.rank() < 2)
      throw InputError(str("BN needs an input of at least 2 axes, found ", input));
    return input;
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    return std::vector<Shape>(of_segnet_ ? 2 : 4, Shape{1, inputs[0][1], 1, 1});
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }

  Rounding rounding() const override { return Rounding::kAmplified; }

  std::optional<WindowHw> window(const Shape&) const override {
    return of_batch_ ? std::nullopt : std::optional(WindowHw{});
  }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>& weights) const override {
    if (of_batch_) return {};
    ChannelAffine affine;
    for (const ChannelNorm& norm : stored(weights)) {
      affine.scale.push_back(norm.factor);
      affine.shift.push_back(norm.shift - double{norm.mean} * norm.factor);
    }
    // A net that is only inspected has no values: any will do.
    affine.scale.resize(inputs[0][1], 1), affine.shift.resize(inputs[0][1], 0);
    return all_finite(affine) ? Form(std::move(affine)) : Form();
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& shape = binding.inputs[0];
    const ChannelRuns runs{shape[0], shape[1], shape.product(2, shape.rank())};
    if (of_batch_) return with_batch_statistics(runs, binding);
    return {"bn",
            [runs, threads = binding.threads, norms = stored(binding.weights)](const Call& call) {
              const float* in = call.inputs[0];
              float* out = call.outputs[0];
              for_each_run(runs, threads, [&](int64_t channel, int64_t begin, int64_t end) {
                const ChannelNorm norm = norms[channel];
                for (int64_t i = begin; i < end; ++i)
                  out[i] = (in[i] - norm.mean) * norm.factor + norm.shift;
              });
            }};
  }

 private:
  std::vector<ChannelNorm> stored(const std::vector<Tensor>& weights) const {
    std::vector<ChannelNorm> norms;
    for (size_t c = 0; c < weights[0].values.size(); ++c) {
      ChannelNorm& norm = norms.emplace_back();
      norm.factor = weights[0].values[c], norm.shift = weights[1].values[c];
      if (of_segnet_) continue;
      norm.mean = weights[2].values[c];
      norm.factor /= std::sqrt(weights[3].values[c] + eps_);
    }
    return norms;
  }

  Kernel with_batch_statistics(const ChannelRuns& runs, const Binding& binding) const {
    return {"bn-of-batch",
            [runs, threads = binding.threads, norms = stored(binding.weights)](const Call& call) {
              parallel_for(runs.channels, threads, [&](int64_t channel, int) {
                const float* in = call.inputs[0] + channel * runs.inner;
                float* out = call.outputs[0] + channel * runs.inner;
                const int64_t stride = runs.channels * runs.inner;
                const Moments m = moments(in, runs.outer, runs.inner, stride);
                const float factor = norms[channel].factor / std::sqrt(m.variance + kEpsOfSegNet);
                for (int64_t n = 0; n < runs.outer; ++n)
                  for (int64_t i = n * stride; i < n * stride + runs.inner; ++i)
                    out[i] = (in[i] - m.mean) * factor + norms[channel].shift;
              });
            }};
  }

  bool of_segnet_, of_batch_;
  float eps_;
};

}  // namespace

std::unique_ptr<Layer> make_bn(const caffe::LayerParameter& param) {
  return std::make_unique<BnLayer>(param.bn_param());
}

}  // namespace revisit::engine
