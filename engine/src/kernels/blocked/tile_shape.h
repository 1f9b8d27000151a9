#pragma once

#include <cstdint>

#include "kernels/blocked/column_panels.h"

namespace revisit::engine {

/// Of an AMX tile: rows of 64 bytes, and the bfloat16 in one. Two tiles of pixels are multiplied
/// together.
constexpr int64_t kTileRows = 16, kTileDepth = 32;
constexpr Panel kTilePanel = {2 * kTileRows, kTileRows};

}  // namespace revisit::engine
