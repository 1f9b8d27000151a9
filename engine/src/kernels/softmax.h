#pragma once

#include <cstdint>

namespace revisit::engine {

/// Scores [outer][classes][inner]: each line has one per class.
struct ClassLines {
  int64_t outer = 0, classes = 0, inner = 0;
};

/// exp(x - max) / sum along the classes; a line with NaN or +infinity becomes NaN. `out` may be
/// `in`. Bitwise equal for any number of threads.
void softmax(const float* in, const ClassLines& lines, float* out, int threads = 1);
/// Direct computation in double precision.
void softmax_reference(const float* in, const ClassLines& lines, float* out);

}  // namespace revisit::engine
