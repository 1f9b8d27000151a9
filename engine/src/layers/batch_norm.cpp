#include <algorithm>
#include <cmath>

#include "kernels/channel_runs.h"
#include "kernels/moments.h"
#include "layers/broadcast.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// (x - mean) / sqrt(variance + eps) per channel, with the statistics of training, or (rare) those
/// of the batch at hand.
class BatchNorm : public OneToOneLayer {
 public:
  explicit BatchNorm(const caffe::LayerParameter& param) : param_(param.batch_norm_param()) {
    const int n = std::min(param.param_size(), 3);
    for (int i = 0; i < n; ++i)
      if (param.param(i).lr_mult() != 0)
        throw InputError("statistics are not learned: lr_mult of every `param` must be 0");
  }

  Shape output_shape(const Shape& input) const override {
    if (input.rank() < 2)
      throw InputError(str("BatchNorm needs an input of at least 2 axes, found ", input));
    return input;
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    const Shape channels{inputs[0][1]};
    return {channels, channels, Shape{1}};
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }

  // With stored statistics, too: in the weights of a convolution the means are subtracted all the
  // same.
  Rounding rounding() const override { return Rounding::kAmplified; }

  std::optional<WindowHw> window(const Shape&) const override {
    return of_batch() ? std::nullopt : std::optional(WindowHw{});
  }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>& weights) const override {
    if (of_batch()) return {};
    const Statistics statistics = stored_statistics(weights);
    ChannelAffine affine;
    for (size_t c = 0; c < statistics.means.size(); ++c) {
      affine.scale.push_back(1.0 / statistics.deviations[c]);
      affine.shift.push_back(-statistics.means[c] / double{statistics.deviations[c]});
    }
    // A net that is only inspected has no values: any will do.
    affine.scale.resize(inputs[0][1], 1), affine.shift.resize(inputs[0][1], 0);
    return all_finite(affine) ? Form(std::move(affine)) : Form();
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& shape = binding.inputs[0];
    const ChannelRuns runs{shape[0], shape[1], shape.product(2, shape.rank())};
    return of_batch() ? with_batch_statistics(runs, binding.threads)
                      : with_stored_statistics(runs, binding);
  }

 private:
  bool of_batch() const { return param_.has_use_global_stats() && !param_.use_global_stats(); }

  struct Statistics {
    std::vector<float> means, deviations;
  };

  Statistics stored_statistics(const std::vector<Tensor>& weights) const {
    const std::vector<float>&sums = weights[0].values, &square_sums = weights[1].values;
    // The file holds sums with a common weight in the third blob; 0 means that nothing was summed.
    const float weight = weights[2].values.empty() ? 0 : weights[2].values[0];
    const float factor = weight == 0 ? 0 : 1 / weight;
    Statistics result;
    for (const float sum : sums) result.means.push_back(factor * sum);
    for (const float sum : square_sums)
      result.deviations.push_back(std::sqrt(factor * sum + param_.eps()));
    return result;
  }

  Kernel with_stored_statistics(const ChannelRuns& runs, const Binding& binding) const {
    Statistics statistics = stored_statistics(binding.weights);
    return {"batch-norm", [runs, threads = binding.threads, means = std::move(statistics.means),
                           deviations = std::move(statistics.deviations)](const Call& call) {
              const float* in = call.inputs[0];
              float* out = call.outputs[0];
              for_each_run(runs, threads, [&](int64_t channel, int64_t begin, int64_t end) {
                const float mean = means[channel], deviation = deviations[channel];
                for (int64_t i = begin; i < end; ++i) out[i] = (in[i] - mean) / deviation;
              });
            }};
  }

  Kernel with_batch_statistics(const ChannelRuns& runs, int threads) const {
    return {"batch-norm-of-batch", [runs, threads, eps = param_.eps()](const Call& call) {
              parallel_for(runs.channels, threads, [&](int64_t channel, int) {
                const float* in = call.inputs[0] + channel * runs.inner;
                float* out = call.outputs[0] + channel * runs.inner;
                const int64_t stride = runs.channels * runs.inner;
                const Moments m = moments(in, runs.outer, runs.inner, stride);
                const float deviation = std::sqrt(m.variance + eps);
                for (int64_t n = 0; n < runs.outer; ++n)
                  for (int64_t i = n * stride; i < n * stride + runs.inner; ++i)
                    out[i] = (in[i] - m.mean) / deviation;
              });
            }};
  }

  caffe::BatchNormParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_batch_norm(const caffe::LayerParameter& param) {
  return std::make_unique<BatchNorm>(param);
}

}  // namespace revisit::engine
