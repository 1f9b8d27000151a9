#pragma once

#include <cstddef>

#include "revisit/engine/tensor.h"

namespace revisit::engine {

/// Returns whether the CPU supports the NCHWc kernels (x86: AVX2). Otherwise all values are NCHW.
bool has_blocked_kernels();

/// Instructions that a kernel needs. With AVX-512 targets, bfloat16 products use AVX512-BF16 or AMX
/// only. A CPU without them runs the entire kernel with AVX2. Sums are bitwise equal; roots may
/// differ by one bit.
enum class Instructions { kFloat32, kBf16, kTiles };

inline Instructions instructions_for(Precision values) {
  return values == Precision::kBf16 ? Instructions::kBf16 : Instructions::kFloat32;
}

size_t target_index(Instructions instructions);

}  // namespace revisit::engine

/// Like HWY_DYNAMIC_DISPATCH, for NCHWc kernels.
#define REVISIT_DISPATCH(FUNCTION, INSTRUCTIONS) \
  (*HWY_DISPATCH_TABLE(FUNCTION)[target_index(INSTRUCTIONS)])
