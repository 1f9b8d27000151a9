#pragma once

#include <span>

#include "kernels/blocked/blocked_size.h"
#include "kernels/epilogue.h"
// NCHWc values have the type `size.values`. Arrays are aligned to their blocks. The output may be
// one of the inputs.
namespace revisit::engine {

void blocked_activation(const BlockedSize& size, const Epilogue& epilogue, const void* input,
                        void* output);

/// input * scale[c] + shift[c], then the epilogue; both are `[padded_channels(c)]`.
void blocked_scale(const BlockedSize& size, const float* scale, const float* shift,
                   const Epilogue& epilogue, const void* input, void* output);

/// Combination of at least two inputs like Caffe's Eltwise, then the epilogue.
struct BlockedEltwise {
  enum class Operation { kSum, kProduct, kMaximum };
  Operation operation = Operation::kSum;
  /// For a sum, one per input. Inputs with coefficient 0 are ignored, so NaN does not propagate.
  std::span<const float> coefficients = {};
  Epilogue epilogue = {};
};
void blocked_eltwise(const BlockedSize& size, const BlockedEltwise& eltwise,
                     std::span<const float* const> inputs, void* output);

/// One factor per image and channel, as in squeeze-and-excitation.
struct BlockedGate {
  const float* factors = nullptr;  // `[n][c]`, NCHW without padding
  const void* addend = nullptr;    // NCHWc, in the input's shape; or null
  /// Ignores the input if the factor is 0, as in BLAS, so NaN does not propagate.
  bool zero_hides = false;
  Epilogue epilogue = {};
};

/// factors[n][c] * input + addend, then the epilogue. The output may also be the addend.
void blocked_gate(const BlockedSize& size, const BlockedGate& gate, const void* input,
                  void* output);

}  // namespace revisit::engine
