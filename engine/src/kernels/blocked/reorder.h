#pragma once

#include "kernels/blocked/blocked_size.h"

namespace revisit::engine {

/// `[n][c][pixels]` to `[n][ceil(c / kLanes)][pixels][kLanes]`, lanes beyond c zero: float32
/// there, `size.values` here.
void reorder_to_blocked(const BlockedSize& size, const float* plain, void* blocked);

/// The way back.
void reorder_to_plain(const BlockedSize& size, const void* blocked, float* plain);

}  // namespace revisit::engine
