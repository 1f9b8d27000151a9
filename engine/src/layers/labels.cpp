#include <algorithm>
#include <cfloat>
#include <cmath>
#include <limits>

#include "kernels/nchw.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

struct LabeledScores {
  AxisRuns lines;
  std::optional<int> ignored;

  /// Throws InputError unless there are two matching inputs and one or two outputs.
  static LabeledScores of(const std::vector<Shape>& inputs, size_t n_outputs, int axis,
                          std::optional<int> ignored) {
    expect_count(inputs.size(), 2, "inputs (scores and labels)");
    expect_1_or_2(n_outputs, "outputs");
    const Shape& scores = inputs[0];
    const AxisRuns lines = runs_along(scores, scores.canonical_axis(axis, "class axis"));
    if (inputs[1].elements() != lines.outer * lines.inner)
      throw InputError("scores of shape ", scores, " need ", lines.outer * lines.inner,
                       " labels, found ", inputs[1].elements());
    return {lines, ignored};
  }

  enum class Kind { kClass, kIgnored, kInvalid };
  /// Classifies the value of a label. For invalid ones Caffe reads beyond the scores, so no correct
  /// result exists; ours is NaN.
  Kind classify(float value) const {
    constexpr float kLimit = 2147483648.0F;  // the conversion is undefined beyond it and for NaN
    if (!(value > -kLimit && value < kLimit)) return Kind::kInvalid;
    const int label = static_cast<int>(value);
    if (label == ignored) return Kind::kIgnored;
    return label >= 0 && label < lines.size ? Kind::kClass : Kind::kInvalid;
  }
};

/// Fraction of labels whose score is among the k best; the second output has it per class.
class AccuracyLayer : public Layer {
 public:
  explicit AccuracyLayer(const caffe::AccuracyParameter& param) : param_(param) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    const int64_t classes = scores(inputs, n_outputs).lines.size;
    if (param_.top_k() > classes)
      throw InputError("top_k ", param_.top_k(), " is more than the ", classes, " classes");
    std::vector<Shape> outputs{Shape{}};
    if (n_outputs == 2) outputs.push_back(Shape{classes});
    return outputs;
  }

  Kernel bind(const Binding& binding) const override {
    const bool by_class = binding.outputs.size() == 2;
    const LabeledScores s = scores(binding.inputs, binding.outputs.size());
    return {"count",
            [s, by_class, top_k = int64_t{param_.top_k()}](const Call& call) {
              count(s, top_k, call, by_class ? call.outputs[1] : nullptr);
            },
            floats(by_class ? s.lines.size : 0)};
  }

 private:
  LabeledScores scores(const std::vector<Shape>& inputs, size_t n_outputs) const {
    std::optional<int> ignored;
    if (param_.has_ignore_label()) ignored = param_.ignore_label();
    return LabeledScores::of(inputs, n_outputs, param_.axis(), ignored);
  }

  /// Equal scores of other classes count as better; NaN is not better than any score.
  static bool is_among_best(const float* line, const AxisRuns& lines, int64_t label,
                            int64_t top_k) {
    int64_t better = -1;  // the loop counts the label itself
    for (int64_t c = 0; c < lines.size && better < top_k; ++c)
      better += line[c * lines.inner] >= line[label * lines.inner];
    return better < top_k;
  }

  /// `hits_of` counts per class and may be null.
  static void count(const LabeledScores& s, int64_t top_k, const Call& call, float* hits_of) {
    using Kind = LabeledScores::Kind;
    const AxisRuns& lines = s.lines;
    float* labels_of = call.scratch;
    for (int64_t c = 0; hits_of && c < lines.size; ++c) hits_of[c] = labels_of[c] = 0;
    int64_t hits = 0, labels = 0;
    bool valid = true;
    for (int64_t o = 0; o < lines.outer; ++o)
      for (int64_t i = 0; i < lines.inner; ++i) {
        const float value = call.inputs[1][o * lines.inner + i];
        const Kind kind = s.classify(value);
        valid &= kind != Kind::kInvalid;
        if (kind != Kind::kClass) continue;
        const auto label = static_cast<int64_t>(value);
        const bool hit =
            is_among_best(call.inputs[0] + o * lines.size * lines.inner + i, lines, label, top_k);
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
    for (int64_t c = 0; hits_of && c < lines.size; ++c)
      hits_of[c] = share(hits_of[c], labels_of[c]);
  }

  caffe::AccuracyParameter param_;
};

using Loss = caffe::LossParameter;

/// Mean of -log(softmax(scores)[label]); the second output has the probabilities.
class SoftmaxWithLoss : public Layer {
 public:
  explicit SoftmaxWithLoss(const caffe::LayerParameter& param)
      : axis_(param.softmax_param().axis()), normalization_(param.loss_param().normalization()) {
    const Loss& loss = param.loss_param();
    if (loss.has_ignore_label()) ignored_ = loss.ignore_label();
    if (!loss.has_normalization() && loss.has_normalize())  // older field
      normalization_ = loss.normalize() ? Loss::VALID : Loss::BATCH_SIZE;
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    LabeledScores::of(inputs, n_outputs, axis_, ignored_);
    if (inputs[0].rank() < 1 || inputs[1].rank() < 1 || inputs[0][0] != inputs[1][0])
      throw InputError("scores and labels must agree in the first axis, found ", inputs[0], " and ",
                       inputs[1]);
    std::vector<Shape> outputs{Shape{}};
    if (n_outputs == 2) outputs.push_back(inputs[0]);
    return outputs;
  }

  Kernel bind(const Binding& binding) const override {
    const bool keeps = binding.outputs.size() == 2;
    const LabeledScores s =
        LabeledScores::of(binding.inputs, binding.outputs.size(), axis_, ignored_);
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
  static float loss(const LabeledScores& s, Loss::NormalizationMode normalization,
                    const float* probabilities, const float* labels) {
    using Kind = LabeledScores::Kind;
    const AxisRuns& lines = s.lines;
    float sum = 0;
    int64_t n_valid = 0;
    for (int64_t o = 0; o < lines.outer; ++o)
      for (int64_t i = 0; i < lines.inner; ++i) {
        const float value = labels[o * lines.inner + i];
        const Kind kind = s.classify(value);
        if (kind == Kind::kInvalid) return std::numeric_limits<float>::quiet_NaN();
        if (kind == Kind::kIgnored) continue;
        const int64_t at = (o * lines.size + static_cast<int64_t>(value)) * lines.inner + i;
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

class EuclideanLoss : public Layer {
 public:
  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 2, "inputs");
    expect_count(n_outputs, 1, "outputs");
    const Shape &a = inputs[0], &b = inputs[1];
    if (a.rank() < 1 || b.rank() < 1 || a[0] != b[0] || a.elements() != b.elements())
      throw InputError(
          "expected equal numbers of images and of values per image in both inputs, found ", a,
          " and ", b);
    return {Shape{}};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& shape = binding.inputs[0];
    return {"euclidean-loss", [n = shape.elements(), images = shape[0]](const Call& call) {
              double sum = 0;
              for (int64_t i = 0; i < n; ++i) {
                const double difference = call.inputs[0][i] - call.inputs[1][i];
                sum += difference * difference;
              }
              *call.outputs[0] = static_cast<float>(sum / static_cast<double>(images) / 2);
            }};
  }
};

}  // namespace

constinit const LayerEntries kLabelsLayers = {
    {"Accuracy", make<AccuracyLayer, &Parameters::accuracy_param>, "Caffe",
     "fraction of labels among the k best scores"},
    {"EuclideanLoss", make<EuclideanLoss>, "Caffe", "half the squared distance, mean over images"},
    {"SoftmaxWithLoss", make<SoftmaxWithLoss>, "Caffe", "mean of -log softmax of the labels"},
};

}  // namespace revisit::engine
