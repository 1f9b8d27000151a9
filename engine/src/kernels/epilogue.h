#pragma once

#include <algorithm>
#include <cstdint>

namespace revisit::engine {

/// Follows bias and addend, in registers. Every activation preserves NaN, as in Caffe.
struct Epilogue {
  enum class Activation {
    kNone,
    kRelu,
    kPrelu,
    kElu,
    kClip,
    kSigmoid,
    kSwish,
    kTanh,
    kBnll,
    kMish
  };
  Activation activation = Activation::kNone;
  float slope = 0;                // kRelu: factor of negative values; kElu: alpha; kSwish: beta
  float low = 0, high = 0;        // kClip; ReLU6 is 0..6
  const float* slopes = nullptr;  // kPrelu: factor of negative values, [padded_channels(c)]
};

/// Caffe's expression, which determines the results for NaN and infinity.
inline float leaky_relu(float x, float slope) {
  return std::max(x, 0.0F) + slope * std::min(x, 0.0F);
}

/// Supports all but kPrelu. `out` may be `in`. Results do not depend on the position of a value.
void activate(const Epilogue& epilogue, int64_t count, const float* in, float* out);

}  // namespace revisit::engine
