#pragma once

#include <cstdint>

namespace revisit::engine {

/// Scores as [outer][classes][inner]: one for each class on every line.
struct ClassLines {
  int64_t outer = 0, classes = 0, inner = 0;
};

/// exp(x - max) / sum along the classes. `out` may be `in`.
void softmax(const float* in, const ClassLines& lines, float* out);

}  // namespace revisit::engine
