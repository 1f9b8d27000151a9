#pragma once

#include <string>

namespace revisit::engine {

/// The instructions that the engine's kernels use on this CPU: "AVX-512", "AVX2", "NEON", ...
std::string simd_target();

/// Whether the CPU multiplies bfloat16 itself (AVX512-BF16). Elsewhere Precision::kBf16 gives the
/// same sums, but its products take longer than those of float32.
bool has_bf16_instructions();

/// Whether it also multiplies whole tiles of them (AMX-BF16), and the operating system lets this
/// process, of which the first call asks it.
bool has_bf16_tiles();

/// What multiplies bfloat16 on this CPU, for people: "AMX tiles", "AVX512-BF16", or "" for nothing.
std::string bf16_instructions();

}  // namespace revisit::engine
