#include "memory_plan.h"

#include <algorithm>

namespace revisit::engine {

MemoryPlan plan_memory(const std::vector<Lifetime>& buffers, int64_t alignment) {
  const auto aligned = [&](int64_t size) { return (size + alignment - 1) / alignment * alignment; };
  std::vector<size_t> order;
  for (size_t i = 0; i < buffers.size(); ++i)
    if (buffers[i].size > 0) order.push_back(i);  // most steps have no scratch and no state
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t a, size_t b) { return buffers[a].size > buffers[b].size; });

  MemoryPlan plan{std::vector<int64_t>(buffers.size(), 0), 0};
  std::vector<size_t> placed;  // by offset
  for (const size_t i : order) {
    const Lifetime& buffer = buffers[i];
    int64_t offset = 0;
    for (const size_t j : placed) {
      const Lifetime& other = buffers[j];
      if (other.last < buffer.first || buffer.last < other.first) continue;
      if (plan.offsets[j] >= offset + buffer.size) break;  // the gap before it is large enough
      offset = std::max(offset, aligned(plan.offsets[j] + other.size));
    }
    plan.offsets[i] = offset;
    plan.total = std::max(plan.total, aligned(offset + buffer.size));
    placed.insert(
        std::upper_bound(placed.begin(), placed.end(), i,
                         [&](size_t a, size_t b) { return plan.offsets[a] < plan.offsets[b]; }),
        i);
  }
  return plan;
}

}  // namespace revisit::engine
