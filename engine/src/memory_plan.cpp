#include "memory_plan.h"

#include <algorithm>
#include <map>
#include <queue>
#include <set>
#include <span>
#include <utility>

namespace revisit::engine {
namespace {

constexpr size_t kMaxSearched = 4096;  // buffers, because the search is quadratic

/// Best-fit heap with a growing end.
class Heap {
 public:
  explicit Heap(int64_t begin) : end_(begin) {}

  int64_t take(int64_t size) {
    const auto gap = by_size_.lower_bound({size, 0});
    if (gap == by_size_.end()) return std::exchange(end_, end_ + size);
    const auto [found, offset] = *gap;
    remove(gaps_.find(offset));
    if (found > size) add(offset + size, found - size);
    return offset;
  }

  void give_back(int64_t offset, int64_t size) {
    const auto next = gaps_.find(offset + size);
    if (next != gaps_.end()) {
      size += next->second;
      remove(next);
    }
    const auto after = gaps_.lower_bound(offset);
    if (after != gaps_.begin()) {
      const auto before = std::prev(after);
      if (before->first + before->second == offset) {
        offset = before->first;
        size += before->second;
        remove(before);
      }
    }
    add(offset, size);
  }

  int64_t end() const { return end_; }

 private:
  using Gaps = std::map<int64_t, int64_t>;  // size by offset

  void add(int64_t offset, int64_t size) {
    gaps_.emplace(offset, size);
    by_size_.emplace(size, offset);
  }
  void remove(Gaps::iterator gap) {
    by_size_.erase({gap->second, gap->first});
    gaps_.erase(gap);
  }

  Gaps gaps_;
  std::set<std::pair<int64_t, int64_t>> by_size_;
  int64_t end_;
};

}  // namespace

MemoryPlan plan_memory(const std::vector<Lifetime>& buffers, int64_t alignment) {
  const auto aligned = [&](int64_t size) { return (size + alignment - 1) / alignment * alignment; };
  std::vector<size_t> order;
  for (size_t i = 0; i < buffers.size(); ++i)
    if (buffers[i].size > 0) order.push_back(i);
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t a, size_t b) { return buffers[a].size > buffers[b].size; });

  MemoryPlan plan{std::vector<int64_t>(buffers.size(), 0), 0};
  std::vector<size_t> placed;  // sorted by offset
  const auto rest = order.begin() + static_cast<int64_t>(std::min(order.size(), kMaxSearched));
  for (const size_t i : std::span(order.begin(), rest)) {
    const Lifetime& buffer = buffers[i];
    int64_t offset = 0;
    for (const size_t j : placed) {
      const Lifetime& other = buffers[j];
      if (other.last < buffer.first || buffer.last < other.first) continue;
      if (plan.offsets[j] >= offset + buffer.size) break;
      offset = std::max(offset, aligned(plan.offsets[j] + other.size));
    }
    plan.offsets[i] = offset;
    plan.total = std::max(plan.total, aligned(offset + buffer.size));
    placed.insert(
        std::upper_bound(placed.begin(), placed.end(), i,
                         [&](size_t a, size_t b) { return plan.offsets[a] < plan.offsets[b]; }),
        i);
  }

  std::stable_sort(rest, order.end(),
                   [&](size_t a, size_t b) { return buffers[a].first < buffers[b].first; });
  Heap heap(plan.total);
  std::priority_queue<std::pair<int, size_t>, std::vector<std::pair<int, size_t>>, std::greater<>>
      alive;  // by last step
  for (const size_t i : std::span(rest, order.end())) {
    for (; !alive.empty() && alive.top().first < buffers[i].first; alive.pop()) {
      const size_t j = alive.top().second;
      heap.give_back(plan.offsets[j], aligned(buffers[j].size));
    }
    plan.offsets[i] = heap.take(aligned(buffers[i].size));
    alive.emplace(buffers[i].last, i);
  }
  plan.total = heap.end();
  return plan;
}

}  // namespace revisit::engine
