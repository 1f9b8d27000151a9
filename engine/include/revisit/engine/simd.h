#pragma once

#include <string>

namespace revisit::engine {

/// The instructions that the engine's kernels use on this CPU: "AVX-512", "AVX2", "NEON", ...
std::string simd_target();

/// Whether the CPU multiplies bfloat16 itself (AVX512-BF16). Elsewhere Precision::kBf16 gives the
/// same numbers, but its products take longer than those of float32.
bool has_bf16_instructions();

}  // namespace revisit::engine
