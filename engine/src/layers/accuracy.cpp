#include <limits>

#include "layers/labels.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// The share of labels whose score is among the k best; the second output says it for each class.
class AccuracyLayer : public Layer {
 public:
  explicit AccuracyLayer(const caffe::AccuracyParameter& param) : param_(param) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    const int64_t classes = scores(inputs, n_outputs).lines.classes;
    if (param_.top_k() > classes)
      throw InputError("top_k ", param_.top_k(), " is more than the ", classes, " classes");
    std::vector<Shape> outputs{Shape{}};
    if (n_outputs == 2) outputs.push_back(Shape{classes});
    return outputs;
  }

  Kernel bind(const Binding& binding) const override {
    const bool by_class = binding.outputs.size() == 2;
    const LabelledScores s = scores(binding.inputs, binding.outputs.size());
    return {"count",
            [s, by_class, top_k = int64_t{param_.top_k()}](const Call& call) {
              count(s, top_k, call, by_class ? call.outputs[1] : nullptr);
            },
            floats(by_class ? s.lines.classes : 0)};
  }

 private:
  LabelledScores scores(const std::vector<Shape>& inputs, size_t n_outputs) const {
    std::optional<int> ignored;
    if (param_.has_ignore_label()) ignored = param_.ignore_label();
    return LabelledScores::of(inputs, n_outputs, param_.axis(), ignored);
  }

  /// Others of the same score are counted as better; NaN is better than nothing.
  static bool is_among_best(const float* line, const ClassLines& lines, int64_t label,
                            int64_t top_k) {
    int64_t better = -1;  // the label itself is as good as itself
    for (int64_t c = 0; c < lines.classes && better < top_k; ++c)
      better += line[c * lines.inner] >= line[label * lines.inner];
    return better < top_k;
  }

  /// `hits_of` classes may be null.
  static void count(const LabelledScores& s, int64_t top_k, const Call& call, float* hits_of) {
    using Kind = LabelledScores::Kind;
    const ClassLines& lines = s.lines;
    float* labels_of = call.scratch;
    for (int64_t c = 0; hits_of && c < lines.classes; ++c) hits_of[c] = labels_of[c] = 0;
    int64_t hits = 0, labels = 0;
    bool valid = true;
    for (int64_t o = 0; o < lines.outer; ++o)
      for (int64_t i = 0; i < lines.inner; ++i) {
        const float value = call.inputs[1][o * lines.inner + i];
        const Kind kind = s.classify(value);
        valid &= kind != Kind::kInvalid;
        if (kind != Kind::kClass) continue;
        const auto label = static_cast<int64_t>(value);
        const bool hit = is_among_best(call.inputs[0] + o * lines.classes * lines.inner + i, lines,
                                       label, top_k);
        hits += hit;
        ++labels;
        if (!hits_of) continue;
        hits_of[label] += static_cast<float>(hit);
        ++labels_of[label];
      }
    const auto share = [valid](float part, float whole) {
      if (!valid) return std::numeric_limits<float>::quiet_NaN();
      return whole == 0 ? 0.0F : part / whole;
    };
    *call.outputs[0] = share(static_cast<float>(hits), static_cast<float>(labels));
    for (int64_t c = 0; hits_of && c < lines.classes; ++c)
      hits_of[c] = share(hits_of[c], labels_of[c]);
  }

  caffe::AccuracyParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_accuracy(const caffe::LayerParameter& param) {
  return std::make_unique<AccuracyLayer>(param.accuracy_param());
}

}  // namespace revisit::engine
