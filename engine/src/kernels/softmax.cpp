#include "kernels/softmax.h"

#include <algorithm>
#include <cmath>

namespace revisit::engine {
namespace {

/// Along one line of `classes` values, `stride` apart.
void normalise(const float* in, int64_t classes, int64_t stride, float* out) {
  float largest = in[0];
  for (int64_t c = 1; c < classes; ++c) largest = std::max(largest, in[c * stride]);
  float sum = 0;
  for (int64_t c = 0; c < classes; ++c) sum += out[c * stride] = std::exp(in[c * stride] - largest);
  for (int64_t c = 0; c < classes; ++c) out[c * stride] /= sum;
}

}  // namespace

void softmax(const float* in, const ClassLines& lines, float* out) {
  for (int64_t o = 0; o < lines.outer; ++o)
    for (int64_t i = 0; i < lines.inner; ++i) {
      const int64_t first = o * lines.classes * lines.inner + i;
      normalise(in + first, lines.classes, lines.inner, out + first);
    }
}

}  // namespace revisit::engine
