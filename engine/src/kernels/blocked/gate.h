#pragma once

#include "kernels/blocked/blocked_size.h"
#include "kernels/epilogue.h"

namespace revisit::engine {

/// One factor for each image and channel, as squeeze-and-excitation has it.
struct BlockedGate {
  const float* factors = nullptr;  // `[n][c]`, plain: not padded
  const void* addend = nullptr;    // of the input's shape, blocked; or null
  /// Where the factor is 0 the input is not looked at, as in BLAS: a NaN there does not show.
  bool zero_hides = false;
  Epilogue epilogue = {};
};

/// factors[n][c] * input + addend, then the epilogue. Blocked arrays are of `size.values` and
/// aligned to their blocks; the output may be one of them.
void blocked_gate(const BlockedSize& size, const BlockedGate& gate, const void* input,
                  void* output);

}  // namespace revisit::engine
