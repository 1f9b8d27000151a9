#pragma once

#include <algorithm>
#include <cstdint>

#include "kernels/epilogue.h"

namespace revisit::engine {

/// Caffe's own expression: it decides what becomes of NaN and infinity.
inline float leaky_relu(float x, float slope) {
  return std::max(x, 0.0F) + slope * std::min(x, 0.0F);
}

/// The activation of `epilogue`, of any kind but kPrelu, on plain values. `out` may be `in`. What
/// becomes of a number does not depend on where it stands.
void activate(const Epilogue& epilogue, int64_t count, const float* in, float* out);

}  // namespace revisit::engine
