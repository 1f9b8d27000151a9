#pragma once

#include <cstddef>

#include "revisit/engine/precision.h"

namespace revisit::engine {

/// Whether the CPU has the targets of the blocked kernels (x86: AVX2). Else all values are plain.
bool has_blocked_kernels();

/// Instructions that a kernel needs. AVX-512 multiplies bfloat16 by AVX512-BF16 and AMX only: a CPU
/// without them runs the whole kernel by AVX2. Sums have the same bits; roots may differ by a bit.
enum class Instructions { kFloat32, kBf16, kTiles };

inline Instructions instructions_for(Precision values) {
  return values == Precision::kBf16 ? Instructions::kBf16 : Instructions::kFloat32;
}

/// The place in one of Highway's tables of the best target on this CPU.
size_t target_index(Instructions instructions);

}  // namespace revisit::engine

/// As HWY_DYNAMIC_DISPATCH, of a kernel on blocked values.
#define REVISIT_DISPATCH(FUNCTION, INSTRUCTIONS) \
  (*HWY_DISPATCH_TABLE(FUNCTION)[target_index(INSTRUCTIONS)])
