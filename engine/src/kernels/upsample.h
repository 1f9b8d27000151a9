#pragma once

#include <cstdint>

namespace revisit::engine {

/// From `planes` images `[h][w]` to `[out_h][out_w]`.
struct UpsamplingProblem {
  int64_t planes = 1, h = 1, w = 1, out_h = 1, out_w = 1;
  int threads = 1;
};

/// Puts every value where the mask of a maximum pooling says it came from (an index h * out_w + w);
/// the rest is zero. The last value wins where several go to one place. A plane whose mask points
/// outside of it, where Caffe aborts, becomes NaN.
void upsample_by_mask(const UpsamplingProblem& problem, const float* input, const float* mask,
                      float* output);

/// Repeats every pixel out_h / h times down and out_w / w times across.
void upsample_nearest(const UpsamplingProblem& problem, const float* input, float* output);

}  // namespace revisit::engine
