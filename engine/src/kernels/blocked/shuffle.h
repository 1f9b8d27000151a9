#pragma once

#include <span>

#include "kernels/blocked/blocked_size.h"

namespace revisit::engine {

/// Channel c of the output is channel `sources[c]` of the input. Arrays must not overlap.
void blocked_shuffle(const BlockedSize& size, std::span<const int64_t> sources, const void* input,
                     void* output);

}  // namespace revisit::engine
