#include <cstring>

#include "layers/layers.h"
#include "revisit/base/hash.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

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

}  // namespace

std::unique_ptr<Layer> make_dropout(const caffe::LayerParameter& param) {
  const caffe::DropoutParameter& dropout = param.dropout_param();
  if (dropout.sample_weights_test()) return std::make_unique<SampledDropout>(param);
  if (dropout.scale_train()) return make_identity(param);
  // Fast R-CNN's training drops values without rescaling, so inference has to rescale.
  caffe::LayerParameter scaling;
  scaling.mutable_power_param()->set_scale(1 / (1 / (1 - dropout.dropout_ratio())));
  return make_power(scaling);
}

}  // namespace revisit::engine
