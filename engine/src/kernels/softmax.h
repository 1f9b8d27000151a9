#pragma once

#include <cstdint>

namespace revisit::engine {

/// Scores as [outer][classes][inner]: one for each class on every line.
struct ClassLines {
  int64_t outer = 0, classes = 0, inner = 0;
};

/// exp(x - max) / sum along the classes; a line with a NaN, or with +infinity, is NaN. `out` may be
/// `in`. The same bits for any number of threads.
void softmax(const float* in, const ClassLines& lines, float* out, int threads = 1);
/// The definition, in double precision.
void softmax_reference(const float* in, const ClassLines& lines, float* out);

}  // namespace revisit::engine
