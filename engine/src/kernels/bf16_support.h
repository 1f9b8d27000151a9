#pragma once

namespace revisit::engine {

/// Instructions for products of bfloat16: none, AVX512-BF16, or AMX tiles as well.
enum class Bf16Support { kNone, kInstructions, kTiles };

/// Makes this process choose and dispatch kernels as on a CPU with `most` at most. For tests.
void limit_bf16_support(Bf16Support most);

}  // namespace revisit::engine
