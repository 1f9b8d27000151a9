#pragma once

#include <cstdint>

namespace revisit::pipeline {

enum class Extreme { kMax, kMin };

/// The extreme of every `window` (odd, >= 3) consecutive elements, an element being `step` floats
/// side by side: out[i] = extreme(in[i] .. in[i + window - 1]) for 0 <= i < n. `in` has
/// n + window - 1 elements and is used as working memory. O(log window) a float.
void sliding_extreme(float* in, int64_t n, int64_t step, int64_t window, Extreme extreme,
                     float* out);

}  // namespace revisit::pipeline
