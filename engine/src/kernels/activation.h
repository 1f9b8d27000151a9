#pragma once

#include <algorithm>
#include <cstdint>

#include "kernels/epilogue.h"

namespace revisit::engine {

/// Caffe's expression, which determines the results for NaN and infinity.
inline float leaky_relu(float x, float slope) {
  return std::max(x, 0.0F) + slope * std::min(x, 0.0F);
}

/// Supports all but kPrelu. `out` may be `in`. Results do not depend on the position of a value.
void activate(const Epilogue& epilogue, int64_t count, const float* in, float* out);

}  // namespace revisit::engine
