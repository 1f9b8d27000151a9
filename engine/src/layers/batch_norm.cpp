#include "layers/batch_norm.h"

#include <algorithm>
#include <cmath>

#include "kernels/channels.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

class BatchNormalization : public OneToOneLayer {
 public:
  Shape output_shape(const Shape& input) const override {
    expect_channels(input, type_);
    return input;
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }

  bool keeps_items(size_t, const std::vector<Shape>&) const override { return !of_batch_; }

  // Also with stored statistics, because the weights of a convolution then subtract the means.
  Rounding rounding() const override { return Rounding::kAmplified; }

  std::optional<WindowHw> window(const Shape&) const override {
    return of_batch_ ? std::nullopt : std::optional(WindowHw{});
  }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>& weights) const override {
    if (of_batch_) return {};
    ChannelAffine affine;
    for (const ChannelNorm& norm : norms(weights)) {
      const double deviation = norm.deviation, factor = norm.factor;
      affine.scale.push_back(factor / deviation);
      affine.shift.push_back(norm.shift - norm.mean * factor / deviation);
    }
    // Without loaded weights any values will do.
    affine.scale.resize(inputs[0][1], 1), affine.shift.resize(inputs[0][1], 0);
    return all_finite(affine) ? Form(std::move(affine)) : Form();
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& shape = binding.inputs[0];
    const AxisRuns runs = runs_along(shape, 1);
    if (!of_batch_)
      return {kernel_,
              [runs, threads = binding.threads, norms = norms(binding.weights)](const Call& call) {
                for_each_run(runs, threads, [&](int64_t channel, int64_t begin, int64_t end) {
                  normalize(norms[channel], call.inputs[0] + begin, end - begin,
                            call.outputs[0] + begin);
                });
              }};
    return {
        str(kernel_, "-of-batch"),
        [this, runs, threads = binding.threads, norms = norms(binding.weights)](const Call& call) {
          parallel_for(runs.size, threads, [&](int64_t channel, int) {
            const int64_t first = channel * runs.inner, stride = runs.size * runs.inner;
            const ChannelNorm norm = with_statistics(
                norms[channel], moments(call.inputs[0] + first, runs.outer, runs.inner, stride));
            for (int64_t i = first; i < runs.elements(); i += stride)
              normalize(norm, call.inputs[0] + i, runs.inner, call.outputs[0] + i);
          });
        }};
  }

 protected:
  BatchNormalization(const char* type, const char* kernel, bool of_batch)
      : type_(type), kernel_(kernel), of_batch_(of_batch) {}

  virtual std::vector<ChannelNorm> norms(const std::vector<Tensor>& weights) const = 0;

  virtual ChannelNorm with_statistics(ChannelNorm norm, const Moments& batch) const = 0;

 private:
  const char *type_, *kernel_;
  bool of_batch_;
};

/// (x - mean) / sqrt(variance + eps). NVIDIA's fork can add a trained scale and bias; its
/// statistics are then not divided, `use_global_stats` does nothing, and eps is at least cuDNN's.
class BatchNorm : public BatchNormalization {
 public:
  explicit BatchNorm(const caffe::LayerParameter& param)
      : BatchNormalization("BatchNorm", "batch-norm", is_of_batch(param)),
        has_scale_(has_scale_and_bias(param.batch_norm_param())),
        eps_(param.batch_norm_param().eps()) {
    constexpr float kMinEpsOfCudnn = 1e-5F;
    if (has_scale_) eps_ = std::max(eps_, kMinEpsOfCudnn);
    const int n = has_scale_ ? 0 : std::min(param.param_size(), 3);
    for (int i = 0; i < n; ++i)
      if (param.param(i).lr_mult() != 0)
        throw InputError("statistics are not trainable: lr_mult of every `param` must be 0");
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    const Shape channels{inputs[0][1]};
    if (has_scale_) return {channels, channels, Shape{1}, channels, channels};
    return {channels, channels, Shape{1}};
  }

 private:
  static bool is_of_batch(const caffe::LayerParameter& param) {
    const caffe::BatchNormParameter& own = param.batch_norm_param();
    return own.has_use_global_stats() && !has_scale_and_bias(own) ? !own.use_global_stats()
                                                                  : is_for_training(param);
  }

  std::vector<ChannelNorm> norms(const std::vector<Tensor>& weights) const override {
    // The file stores sums, with a common weight in the third blob; 0 means no samples.
    const float weight = weights[2].values.empty() ? 0 : weights[2].values[0];
    const float factor = has_scale_ ? 1 : weight == 0 ? 0 : 1 / weight;
    std::vector<ChannelNorm> norms;
    for (size_t c = 0; c < weights[0].values.size(); ++c) {
      norms.push_back({.mean = factor * weights[0].values[c],
                       .deviation = std::sqrt(factor * weights[1].values[c] + eps_)});
      if (!has_scale_) continue;
      norms.back().factor = weights[3].values[c];
      norms.back().shift = weights[4].values[c];
    }
    return norms;
  }

  ChannelNorm with_statistics(ChannelNorm norm, const Moments& batch) const override {
    norm.mean = batch.mean;
    norm.deviation = std::sqrt(batch.variance + eps_);
    return norm;
  }

  bool has_scale_;
  float eps_;
};

/// Two forks have this layer. PSPNet's stores mean and variance in separate blobs. SegNet's has
/// scale and shift only: INFERENCE includes the statistics, LEARN uses those of the batch.
class Bn : public BatchNormalization {
 public:
  using Param = caffe::BNParameter;

  explicit Bn(const Param& param)
      : BatchNormalization("BN", "bn", is_of_segnet(param) && param.bn_mode() == Param::LEARN),
        of_segnet_(is_of_segnet(param)),
        eps_(param.eps()) {
    const bool of_pspnet = param.has_slope_filler() || param.has_bias_filler() ||
                           param.has_frozen() || param.has_momentum() || param.has_eps();
    if (of_segnet_ && of_pspnet)
      throw InputError(
          "bn_param has fields of SegNet's BN (scale_filler, shift_filler, bn_mode) and of "
          "PSPNet's (slope_filler, bias_filler, frozen, momentum, eps), which have other weights");
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    return std::vector<Shape>(of_segnet_ ? 2 : 4, Shape{1, inputs[0][1], 1, 1});
  }

 private:
  std::vector<ChannelNorm> norms(const std::vector<Tensor>& weights) const override {
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

  ChannelNorm with_statistics(ChannelNorm norm, const Moments& batch) const override {
    constexpr float kEpsOfSegNet = 1e-9F;
    norm.mean = batch.mean;
    norm.factor /= std::sqrt(batch.variance + kEpsOfSegNet);
    return norm;
  }

  bool of_segnet_;
  float eps_;
};

std::unique_ptr<Layer> make_bn(const caffe::LayerParameter& param) {
  if (is_for_training(param))
    throw UnsupportedError(
        "`phase: TRAIN` on a BN layer is not supported: remove it, or write "
        "bn_mode: LEARN (SegNet) for the statistics of the batch");
  return std::make_unique<Bn>(param.bn_param());
}

}  // namespace

constinit const LayerEntries kBatchNormLayers = {
    {"BatchNorm", make<BatchNorm>, "Caffe",
     "(x - mean) / deviation per channel; NVIDIA's with scale and bias", kTrained},
    {"BN", make_bn, "PSPNet, SegNet", "batch normalization with trained scale and shift", kTrained},
};

}  // namespace revisit::engine
