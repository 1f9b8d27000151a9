#pragma once

#include <cstdint>

namespace revisit::engine {

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
