#pragma once

namespace revisit::engine {

/// Number format of values between layers.
enum class Precision {
  kFloat32,
  /// bfloat16, the upper 16 bits of a float32, for values between NCHWc kernels and the weights of
  /// their matrix products. Sums, normalization, Winograd's algorithm and all NCHW values
  /// (including inputs and outputs of the net) stay in float32.
  kBf16,
};

}  // namespace revisit::engine
