#pragma once

#include <cstdint>
#include <vector>

namespace revisit::engine {

/// A buffer that must hold its `size` from step `first` to step `last`, inclusive.
struct Lifetime {
  int64_t size = 0;
  int first = 0, last = 0;
};

struct MemoryPlan {
  std::vector<int64_t> offsets;  // of each buffer
  int64_t total = 0;
};

/// Places buffers in one arena so that those alive at the same time do not overlap: largest first,
/// each into the lowest gap that holds it; of very many, the smaller ones step by step above these.
/// Offsets are multiples of `alignment`; 0 for empty ones.
MemoryPlan plan_memory(const std::vector<Lifetime>& buffers, int64_t alignment);

}  // namespace revisit::engine
