#pragma once

namespace revisit::engine {

/// Instructions for bfloat16 products: none, AVX512-BF16, or also AMX tiles.
enum class Bf16Support { kNone, kInstructions, kTiles };

/// Limits the choice and dispatch of kernels in this process as on a CPU with `most`. For tests.
void limit_bf16_support(Bf16Support most);

}  // namespace revisit::engine
