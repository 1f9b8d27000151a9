#pragma once

#include <cstdint>

namespace revisit {

enum class Extreme { kMax, kMin };

/// Computes the extreme of every `window` (odd, >= 3) consecutive elements: out[i] = extreme(in[i]
/// .. in[i + window - 1]) for 0 <= i < n. An element is `step` adjacent floats. `in` has n + window
/// - 1 elements and is overwritten. O(log window) per float.
void sliding_extreme(float* in, int64_t n, int64_t step, int64_t window, Extreme extreme,
                     float* out);

}  // namespace revisit
