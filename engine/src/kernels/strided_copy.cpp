#include "kernels/strided_copy.h"

#include <algorithm>

#include "revisit/engine/parallel_for.h"

namespace revisit::engine {

void strided_copy(const StridedCopyProblem& p, const float* input, float* output) {
  const size_t last = p.shape.size() - 1;
  const int64_t width = p.shape[last], stride = p.strides[last];
  int64_t rows = 1;
  for (size_t axis = 0; axis < last; ++axis) rows *= p.shape[axis];
  const int64_t grain = std::max<int64_t>(kParallelGrain / width, 1);
  parallel_ranges(rows, grain, p.threads, [&](int64_t begin, int64_t end) {
    for (int64_t row = begin; row < end; ++row) {
      const float* in = input + p.offset;
      for (int64_t axis = static_cast<int64_t>(last) - 1, rest = row; axis >= 0; --axis) {
        in += rest % p.shape[axis] * p.strides[axis];
        rest /= p.shape[axis];
      }
      float* out = output + row * width;
      if (stride == 1)
        std::copy_n(in, width, out);
      else
        for (int64_t i = 0; i < width; ++i) out[i] = in[i * stride];
    }
  });
}

}  // namespace revisit::engine
