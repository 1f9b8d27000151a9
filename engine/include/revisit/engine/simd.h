#pragma once

#include <string>

namespace revisit::engine {

/// Returns the instruction set of the engine's kernels on this CPU: "AVX-512", "AVX2", "NEON", ...
std::string simd_target();

/// Returns whether the CPU multiplies bfloat16 natively (AVX512-BF16). Without that,
/// Precision::kBf16 yields the same sums, but its products are slower than in float32.
bool has_bf16_instructions();

/// Returns whether the CPU has bfloat16 tiles (AMX-BF16) and the operating system permits this
/// process to use them. The first call requests the permission.
bool has_bf16_tiles();

/// Returns the bfloat16 instructions of this CPU: "AMX tiles", "AVX512-BF16", or "" if none.
std::string bf16_instructions();

}  // namespace revisit::engine
