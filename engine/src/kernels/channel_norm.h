#pragma once

#include <cmath>
#include <cstdint>

namespace revisit::engine {

/// Maps x to (x - mean) / deviation * factor + shift. The defaults are the bitwise identity.
struct ChannelNorm {
  float mean = 0, deviation = 1, factor = 1, shift = -0.0F;
};

/// Normalizes `count` values of one channel. `out` may be `in`.
inline void normalize(const ChannelNorm& norm, const float* in, int64_t count, float* out) {
  const auto [mean, deviation, factor, shift] = norm;
  // Skips operations with default arguments, with bitwise equal results.
  if (deviation != 1)
    for (int64_t i = 0; i < count; ++i) out[i] = (in[i] - mean) / deviation * factor + shift;
  else if (mean != 0)
    for (int64_t i = 0; i < count; ++i) out[i] = (in[i] - mean) * factor + shift;
  else if (factor == 1)
    for (int64_t i = 0; i < count; ++i) out[i] = in[i] + shift;
  else if (shift == 0 && std::signbit(shift))
    for (int64_t i = 0; i < count; ++i) out[i] = in[i] * factor;
  else
    for (int64_t i = 0; i < count; ++i) out[i] = in[i] * factor + shift;
}

}  // namespace revisit::engine
