#pragma once

#include <cstdint>

namespace revisit::engine {

/// What is done to the numbers of a channel: (x - mean) / deviation * factor + shift. What is not
/// given leaves every bit as it is.
struct ChannelNorm {
  float mean = 0, deviation = 1, factor = 1, shift = -0.0F;
};

/// Of `count` numbers of one channel. `out` may be `in`.
inline void normalise(const ChannelNorm& norm, const float* in, int64_t count, float* out) {
  const auto [mean, deviation, factor, shift] = norm;
  if (deviation == 1 && mean == 0)
    for (int64_t i = 0; i < count; ++i) out[i] = in[i] * factor + shift;
  else if (deviation == 1)
    for (int64_t i = 0; i < count; ++i) out[i] = (in[i] - mean) * factor + shift;
  else
    for (int64_t i = 0; i < count; ++i) out[i] = (in[i] - mean) / deviation * factor + shift;
}

}  // namespace revisit::engine
