#pragma once

#include <string>

namespace revisit::engine {

/// The instructions that the engine's kernels use on this CPU: "AVX-512", "AVX2", "NEON", ...
std::string simd_target();

}  // namespace revisit::engine
