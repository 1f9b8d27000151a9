#pragma once

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

}  // namespace revisit::engine
