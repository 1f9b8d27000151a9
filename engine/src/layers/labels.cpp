#include "layers/labels.h"

namespace revisit::engine {

LabelledScores LabelledScores::of(const std::vector<Shape>& inputs, size_t n_outputs, int axis,
                                  std::optional<int> ignored) {
  expect_count(inputs.size(), 2, "inputs (scores and labels)");
  if (n_outputs < 1 || n_outputs > 2)
    throw InputError("expected 1 or 2 outputs, found ", n_outputs);
  const Shape& scores = inputs[0];
  const size_t classes = scores.canonical_axis(axis, "class axis");
  const ClassLines lines{scores.product(0, classes), scores[classes],
                         scores.product(classes + 1, scores.rank())};
  if (inputs[1].elements() != lines.outer * lines.inner)
    throw InputError("scores of shape ", scores, " need ", lines.outer * lines.inner,
                     " labels, found ", inputs[1].elements());
  return {lines, ignored};
}

LabelledScores::Kind LabelledScores::classify(float value) const {
  constexpr float kLimit = 2147483648.0F;  // beyond, and for NaN, the conversion is undefined
  if (!(value > -kLimit && value < kLimit)) return Kind::kInvalid;
  const int label = static_cast<int>(value);
  if (label == ignored) return Kind::kIgnored;
  return label >= 0 && label < lines.classes ? Kind::kClass : Kind::kInvalid;
}

}  // namespace revisit::engine
