#include "kernels/strided_copy.h"

#include <algorithm>

#include "revisit/engine/parallel_for.h"

namespace revisit::engine {

void strided_copy(const StridedCopyProblem& p, const float* input, float* output) {
  const size_t last = p.shape.size() - 1;
  const int64_t width = p.shape[last], stride = p.strides[last];
  const int64_t height = last > 0 ? p.shape[last - 1] : 1;
  const int64_t step = last > 0 ? p.strides[last - 1] : 0;
  int64_t rows = 1;
  for (size_t axis = 0; axis < last; ++axis) rows *= p.shape[axis];
  const int64_t grain = std::max<int64_t>(kParallelGrain / width, 1);
  parallel_ranges(rows, grain, p.threads, [&](int64_t begin, int64_t end) {
    float* out = output + begin * width;
    for (int64_t row = begin; row < end;) {
      const float* in = input + p.offset + row % height * step;
      for (int64_t axis = static_cast<int64_t>(last) - 2, rest = row / height; axis >= 0; --axis) {
        in += rest % p.shape[axis] * p.strides[axis];
        rest /= p.shape[axis];
      }
      const int64_t stop = std::min(end, row - row % height + height);
      for (; row < stop; ++row, in += step, out += width) {
        if (stride == 1)
          std::copy_n(in, width, out);
        else if (stride == -1)
          std::reverse_copy(in - width + 1, in + 1, out);
        else
          for (int64_t i = 0; i < width; ++i) out[i] = in[i * stride];
      }
    }
  });
}

}  // namespace revisit::engine
