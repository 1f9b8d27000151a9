#include <algorithm>
#include <cfloat>
#include <cmath>
#include <limits>

#include "layers/labels.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

using Loss = caffe::LossParameter;

/// The mean of -log(softmax(scores)[label]); the second output are the probabilities.
class SoftmaxWithLoss : public Layer {
 public:
  explicit SoftmaxWithLoss(const caffe::LayerParameter& param)
      : axis_(param.softmax_param().axis()), normalization_(param.loss_param().normalization()) {
    const Loss& loss = param.loss_param();
    if (loss.has_ignore_label()) ignored_ = loss.ignore_label();
    if (!loss.has_normalization() && loss.has_normalize())  // the old way to say it
      normalization_ = loss.normalize() ? Loss::VALID : Loss::BATCH_SIZE;
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    LabelledScores::of(inputs, n_outputs, axis_, ignored_);
    std::vector<Shape> outputs{Shape{}};
    if (n_outputs == 2) outputs.push_back(inputs[0]);
    return outputs;
  }

  Kernel bind(const Binding& binding) const override {
    const bool keeps = binding.outputs.size() == 2;
    const LabelledScores s =
        LabelledScores::of(binding.inputs, binding.outputs.size(), axis_, ignored_);
    return {binding.reference_kernels ? "reference" : "softmax-loss",
            [s, keeps, reference = binding.reference_kernels,
             normalization = normalization_](const Call& call) {
              float* probabilities = keeps ? call.outputs[1] : call.scratch;
              if (reference)
                softmax_reference(call.inputs[0], s.lines, probabilities);
              else
                softmax(call.inputs[0], s.lines, probabilities);
              *call.outputs[0] = loss(s, normalization, probabilities, call.inputs[1]);
            },
            floats(keeps ? 0 : binding.inputs[0].elements())};
  }

 private:
  static float loss(const LabelledScores& s, Loss::NormalizationMode normalization,
                    const float* probabilities, const float* labels) {
    using Kind = LabelledScores::Kind;
    const ClassLines& lines = s.lines;
    float sum = 0;
    int64_t n_valid = 0;
    for (int64_t o = 0; o < lines.outer; ++o)
      for (int64_t i = 0; i < lines.inner; ++i) {
        const float value = labels[o * lines.inner + i];
        const Kind kind = s.classify(value);
        if (kind == Kind::kInvalid) return std::numeric_limits<float>::quiet_NaN();
        if (kind == Kind::kIgnored) continue;
        const int64_t at = (o * lines.classes + static_cast<int64_t>(value)) * lines.inner + i;
        sum -= std::log(std::max(probabilities[at], FLT_MIN));
        ++n_valid;
      }
    const int64_t n = normalization == Loss::FULL         ? lines.outer * lines.inner
                      : normalization == Loss::VALID      ? n_valid
                      : normalization == Loss::BATCH_SIZE ? lines.outer
                                                          : 1;
    return sum / static_cast<float>(std::max<int64_t>(n, 1));
  }

  int axis_;
  Loss::NormalizationMode normalization_;
  std::optional<int> ignored_;
};

}  // namespace

std::unique_ptr<Layer> make_softmax_with_loss(const caffe::LayerParameter& param) {
  return std::make_unique<SoftmaxWithLoss>(param);
}

}  // namespace revisit::engine
