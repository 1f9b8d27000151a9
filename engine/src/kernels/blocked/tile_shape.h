#pragma once

#include <cstdint>

#include "kernels/blocked/column_panels.h"

namespace revisit::engine {

/// Rows of an AMX tile, 64 bytes each, and bfloat16 per row. Two tiles of pixels are multiplied
/// together.
constexpr int64_t kTileRows = 16, kTileDepth = 32;
constexpr Panel kTilePanel = {2 * kTileRows, kTileRows};

}  // namespace revisit::engine
