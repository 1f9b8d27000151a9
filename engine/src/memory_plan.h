#pragma once

#include <cstdint>
#include <vector>

namespace revisit::engine {

/// A buffer of `size` that is live from step `first` to step `last`, inclusive.
struct Lifetime {
  int64_t size = 0;
  int first = 0, last = 0;
};

struct MemoryPlan {
  std::vector<int64_t> offsets;
  int64_t total = 0;
};

/// Places buffers in an arena so that buffers with overlapping lifetimes do not overlap. Places the
/// largest first, each into the lowest sufficient gap. If there are very many, places the smaller
/// ones step by step above these. Offsets are multiples of `alignment`; 0 for empty buffers.
MemoryPlan plan_memory(const std::vector<Lifetime>& buffers, int64_t alignment);

}  // namespace revisit::engine
