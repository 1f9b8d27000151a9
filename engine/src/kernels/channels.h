#pragma once

#include <cmath>
#include <cstdint>

#include "kernels/nchw.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {

/// Calls `work(channel, begin, end)` for parts of runs that together cover all elements.
template <class Work>
void for_each_run(const AxisRuns& runs, int threads, const Work& work) {
  parallel_ranges(runs.elements(), kParallelGrain, threads, [&](int64_t begin, int64_t end) {
    int64_t channel = begin / runs.inner % runs.size;
    int64_t run_end = (begin / runs.inner + 1) * runs.inner;
    while (begin < end) {
      const int64_t stop = std::min(run_end, end);
      work(channel, begin, stop);
      begin = stop;
      run_end += runs.inner;
      if (++channel == runs.size) channel = 0;
    }
  });
}

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

/// Mean and population variance of values in `runs` runs of `length`, `stride` apart. Sums are in
/// double, so that the order of summation has no visible effect.
struct Moments {
  float mean, variance;
};

inline Moments moments(const float* in, int64_t runs, int64_t length, int64_t stride) {
  const auto count = static_cast<double>(runs * length);
  double sum = 0, squares = 0;
  for (int64_t run = 0; run < runs; ++run)
    for (int64_t i = 0; i < length; ++i) sum += in[run * stride + i];
  const auto mean = static_cast<float>(sum / count);
  for (int64_t run = 0; run < runs; ++run)
    for (int64_t i = 0; i < length; ++i) {
      const double difference = in[run * stride + i] - mean;  // in float, as in Caffe
      squares += difference * difference;
    }
  return {mean, static_cast<float>(squares / count)};
}

}  // namespace revisit::engine
