#pragma once

#include <cstdint>

#include "kernels/blocked/column_panels.h"

namespace revisit::engine {

/// Rows of an AMX tile, of 64 bytes, and bfloat16 in one. Two tiles of pixels go together.
constexpr int64_t kTileRows = 16, kTileDepth = 32;
constexpr Panel kTilePanel = {2 * kTileRows, kTileRows};

}  // namespace revisit::engine
