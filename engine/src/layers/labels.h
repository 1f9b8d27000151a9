#pragma once

#include <optional>

#include "kernels/softmax.h"
#include "layer.h"

namespace revisit::engine {

/// What Accuracy and SoftmaxWithLoss share: scores, and a label for each line of them.
struct LabelledScores {
  ClassLines lines;
  std::optional<int> ignored;  // a label that does not count

  /// Throws InputError unless there are two inputs that fit each other and one or two outputs.
  static LabelledScores of(const std::vector<Shape>& inputs, size_t n_outputs, int axis,
                           std::optional<int> ignored);

  enum class Kind { kClass, kIgnored, kInvalid };
  /// What the value of a label means. Invalid ones make the original read beyond the scores: no
  /// result is right then, and ours is NaN.
  Kind classify(float value) const;
};

}  // namespace revisit::engine
