#pragma once

namespace revisit::engine {

/// The numbers that a plan keeps between layers.
enum class Precision {
  kFloat32,
  /// bfloat16, a float32 without its last 16 bits: values between the kernels that work on blocks
  /// of channels, and the weights of their matrix products. Sums, normalisation, Winograd's
  /// algorithm and all plain values (inputs and outputs of the net among them) stay in float32.
  kBf16,
};

}  // namespace revisit::engine
