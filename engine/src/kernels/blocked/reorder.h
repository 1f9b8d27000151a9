#pragma once

#include "kernels/blocked/blocked_size.h"

namespace revisit::engine {

/// Converts float32 `[n][c][pixels]` to NCHWc of type `size.values`, with zeros in lanes beyond c.
void reorder_to_nchwc(const BlockedSize& size, const float* plain, void* blocked);

void reorder_to_nchw(const BlockedSize& size, const void* blocked, float* plain);

}  // namespace revisit::engine
