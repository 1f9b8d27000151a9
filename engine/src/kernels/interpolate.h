#pragma once

#include <cstdint>

namespace revisit::engine {

/// Bilinear resizing of `planes` images `[h][w]`, of which the part `[cropped_h][cropped_w]` that
/// starts `crop` pixels from the top and the left is used. Corner pixels map to corner pixels.
struct InterpolationProblem {
  int64_t planes = 1, h = 1, w = 1;
  int64_t crop = 0, cropped_h = 1, cropped_w = 1;
  int64_t out_h = 1, out_w = 1;
  int threads = 1;
};
void interpolate(const InterpolationProblem& problem, const float* input, float* output);

}  // namespace revisit::engine
