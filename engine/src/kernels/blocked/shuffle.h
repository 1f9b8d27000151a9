#pragma once

#include <span>

#include "kernels/blocked/blocked_size.h"

namespace revisit::engine {

/// Makes channel `sources[c]` of the input channel c of the output. Arrays must not overlap.
void blocked_shuffle(const BlockedSize& size, std::span<const int64_t> sources, const void* input,
                     void* output);

}  // namespace revisit::engine
