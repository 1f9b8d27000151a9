#include <cmath>

#include "kernels/channel_norm.h"
#include "kernels/moments.h"
#include "layers/layers.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

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

std::unique_ptr<Layer> make_mvn(const caffe::LayerParameter& param) {
  return std::make_unique<Mvn>(param.mvn_param());
}

}  // namespace revisit::engine
