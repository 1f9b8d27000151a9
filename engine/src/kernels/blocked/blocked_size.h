#pragma once

#include <cstdint>

#include "layout.h"

namespace revisit::engine {

struct BlockedSize {
  int64_t n = 1, c = 1, pixels = 1;
  int threads = 1;
  Precision values = Precision::kFloat32;

  int64_t planes() const { return n * channel_blocks(c); }
};

}  // namespace revisit::engine
