#pragma once

#include <span>

#include "kernels/blocked/blocked_size.h"
#include "kernels/epilogue.h"

// Kernels on each element of blocked values by itself, of `size.values`. All arrays are aligned to
// their blocks; the output may be one of the inputs.
namespace revisit::engine {

/// The activation of `epilogue` alone.
void blocked_activation(const BlockedSize& size, const Epilogue& epilogue, const void* input,
                        void* output);

/// input * scale[c] + shift[c], then the epilogue; both are `[padded_channels(c)]`.
void blocked_scale(const BlockedSize& size, const float* scale, const float* shift,
                   const Epilogue& epilogue, const void* input, void* output);

/// At least two inputs of `size.values`, combined as Caffe's Eltwise does, then the epilogue.
struct BlockedEltwise {
  enum class Operation { kSum, kProduct, kMaximum };
  Operation operation = Operation::kSum;
  /// Of a sum, one for each input. Where it is 0 the input is not looked at: NaN does not show.
  std::span<const float> coefficients = {};
  Epilogue epilogue = {};
};
void blocked_eltwise(const BlockedSize& size, const BlockedEltwise& eltwise,
                     std::span<const float* const> inputs, void* output);

/// One factor for each image and channel, as squeeze-and-excitation has it.
struct BlockedGate {
  const float* factors = nullptr;  // `[n][c]`, plain: not padded
  const void* addend = nullptr;    // of the input's shape, blocked; or null
  /// Where the factor is 0 the input is not looked at, as in BLAS: a NaN there does not show.
  bool zero_hides = false;
  Epilogue epilogue = {};
};

/// factors[n][c] * input + addend, then the epilogue. The output may be the addend, too.
void blocked_gate(const BlockedSize& size, const BlockedGate& gate, const void* input,
                  void* output);

}  // namespace revisit::engine
