#include <algorithm>
#include <map>
#include <queue>
#include <set>
#include <span>
#include <unordered_set>
#include <utility>

#include "schedule.h"

namespace revisit::engine {
namespace {

constexpr int64_t kAlignment = 64;  // [bytes]: one cache line, one AVX-512 register
constexpr int kBefore = -1;         // before all steps

struct Buffer {
  std::string what;
  int64_t bytes = 0;
  int first = 0, last = 0;  // steps
  int parent = -1;
  int64_t offset_in_parent = 0;
};

class Placer {
 public:
  Placer(const Net::Impl& net, Schedule& schedule)
      : net_(net),
        schedule_(schedule),
        end_(static_cast<int>(schedule.steps.size())),
        last_use_(schedule.stored.size(), -1),
        last_join_(schedule.stored.size(), -1),
        buffer_of_(schedule.stored.size(), -1) {
    for (int step = 0; step < end_; ++step)
      for (const size_t id : schedule.steps[step].inputs) {
        last_use_[id] = step;
        if (schedule.steps[step].kernel.aliasing == Aliasing::kJoinsInputs) last_join_[id] = step;
      }
    for (size_t id = 0; id < schedule.stored.size(); ++id)
      if (schedule.stored[id].pinned) last_use_[id] = end_;
  }

  void run() {
    // Inputs keep their values across forward passes, so no other buffer may share their memory.
    for (const size_t id : schedule_.inputs)
      add_buffer(id, kBefore, net_.graph.values[schedule_.stored[id].value].blob);
    n_inputs_ = buffers_.size();
    for (int step = 0; step < end_; ++step) add_step(step);
    lay_out();
  }

 private:
  void add_step(int index) {
    Step& step = schedule_.steps[index];
    const std::string& name = net_.graph.nodes[step.layer].name;
    const bool joined = step.kernel.aliasing == Aliasing::kJoinsInputs && can_join(step);
    const size_t n_cut = step.kernel.aliasing == Aliasing::kCutsInput ? cut(step, index) : 0;
    int64_t bytes = 0;
    for (size_t port = 0; port < step.outputs.size(); ++port) {
      const size_t output = step.outputs[port];
      if (buffer_of_[output] >= 0) continue;
      if (step.memory == OutputMemory::kViewOfInput || (port == 0 && may_overwrite(step, index))) {
        share(output, step.inputs[0]);
      } else {
        add_buffer(output, index, name);
        bytes += schedule_.stored[output].bytes;
      }
    }
    if (joined) join(step);
    step.new_bytes = joined ? 0 : bytes;
    step.runs = step.memory != OutputMemory::kViewOfInput && !joined && n_cut < step.outputs.size();
    scratch_.push_back(add(name + " (scratch)", step.kernel.scratch.count, index, index));
    state_.push_back(add(name + " (state)", step.kernel.state.count, kBefore, end_));
  }

  int add(std::string what, int64_t bytes, int first, int last) {
    buffers_.push_back({std::move(what), bytes, first, last});
    return static_cast<int>(buffers_.size()) - 1;
  }

  void add_buffer(size_t id, int step, const std::string& what) {
    buffer_of_[id] = add(what, schedule_.stored[id].bytes, step, std::max(step, last_use_[id]));
  }

  void share(size_t id, size_t with) {
    buffer_of_[id] = buffer_of_[with];
    outlive(buffer_of_[id], last_use_[id]);
  }

  void outlive(int buffer, int step) {
    for (int b = buffer; b >= 0; b = buffers_[b].parent)
      buffers_[b].last = std::max(buffers_[b].last, step);
  }

  /// Returns whether the first output can overwrite the first input. No later step may read its
  /// root buffer under any name, and no other input of this step may be in it.
  bool may_overwrite(const Step& step, int index) const {
    if (step.memory != OutputMemory::kMayReuseInput) return false;
    const size_t first = step.inputs[0];
    const Stored &input = schedule_.stored[first], &output = schedule_.stored[step.outputs[0]];
    const int whole = root(buffer_of_[first]);
    return input.layout == output.layout && input.bytes == output.bytes &&
           buffers_[whole].last <= index &&
           std::all_of(step.inputs.begin(), step.inputs.end(),
                       [&](size_t id) { return id == first || root(buffer_of_[id]) != whole; });
  }

  int root(int buffer) const {
    while (buffers_[buffer].parent >= 0) buffer = buffers_[buffer].parent;
    return buffer;
  }

  /// Parts of the output must be aligned to blocks (NCHWc) or cache lines (NCHW).
  bool can_join(const Step& step) const {
    std::unordered_set<int> seen;
    for (size_t i = 0; i < step.inputs.size(); ++i) {
      const int b = buffer_of_[step.inputs[i]];
      const bool is_input = static_cast<size_t>(b) < n_inputs_;
      if (is_input || buffers_[b].parent >= 0 || !seen.insert(b).second ||
          (i + 1 < step.inputs.size() && buffers_[b].bytes % kAlignment != 0 &&
           schedule_.stored[step.inputs[i]].layout == Layout::kNchw))
        return false;
    }
    return true;
  }

  void join(const Step& step) {
    const int whole = buffer_of_[step.outputs[0]];
    int64_t offset = 0;
    for (const size_t input : step.inputs) {
      Buffer& part = buffers_[buffer_of_[input]];
      part.parent = whole;
      part.offset_in_parent = offset;
      offset += part.bytes;
      buffers_[whole].first = std::min(buffers_[whole].first, part.first);
      buffers_[whole].last = std::max(buffers_[whole].last, part.last);
    }
  }

  /// NCHW parts must be aligned to a cache line. A later join would move the part.
  bool can_cut(size_t id, int64_t offset, int index) const {
    const bool plain = schedule_.stored[id].layout == Layout::kNchw;
    return (!plain || offset % kAlignment == 0) && last_join_[id] < index;
  }

  /// Returns the number of outputs that became parts of the input.
  size_t cut(const Step& step, int index) {
    size_t count = 0;
    int64_t offset = 0;
    for (const size_t id : step.outputs) {
      const int64_t bytes = schedule_.stored[id].bytes;
      if (can_cut(id, offset, index)) {
        add_buffer(id, index, net_.graph.nodes[step.layer].name);
        Buffer& part = buffers_[buffer_of_[id]];
        part.parent = buffer_of_[step.inputs[0]];
        part.offset_in_parent = offset;
        outlive(part.parent, part.last);
        ++count;
      }
      offset += bytes;
    }
    return count;
  }

  void lay_out() {
    std::vector<Lifetime> lifetimes;
    for (const Buffer& buffer : buffers_)
      lifetimes.push_back({buffer.parent < 0 ? buffer.bytes : 0, buffer.first, buffer.last});
    const MemoryPlan memory = plan_memory(lifetimes, kAlignment);
    const auto offset_of = [&](int b) {
      int64_t offset = 0;
      for (; buffers_[b].parent >= 0; b = buffers_[b].parent)
        offset += buffers_[b].offset_in_parent;
      return memory.offsets[b] + offset;
    };
    for (size_t id = 0; id < buffer_of_.size(); ++id)
      schedule_.stored[id].offset = offset_of(buffer_of_[id]);
    for (int step = 0; step < end_; ++step) {
      schedule_.steps[step].scratch = offset_of(scratch_[step]);
      schedule_.steps[step].state = offset_of(state_[step]);
    }
    schedule_.arena_bytes = memory.total;
    for (size_t b = 0; b < buffers_.size(); ++b) describe(buffers_[b], memory.offsets[b]);
  }

  void describe(const Buffer& buffer, int64_t offset) {
    if (buffer.parent >= 0 || buffer.bytes == 0) return;
    const auto layer_of = [&](int step) {
      return step == kBefore ? 0
             : step == end_  ? net_.graph.nodes.size()
                             : schedule_.steps[step].layer;
    };
    schedule_.buffers.push_back(
        {buffer.what, offset, buffer.bytes, layer_of(buffer.first), layer_of(buffer.last)});
  }

  const Net::Impl& net_;
  Schedule& schedule_;
  const int end_;
  std::vector<int> last_use_;         // per stored value: step, or end_ if read after the run
  std::vector<int> last_join_;        // per stored value: last step that joins it, or -1
  std::vector<int> buffer_of_;        // per stored value
  std::vector<int> scratch_, state_;  // per step
  std::vector<Buffer> buffers_;
  size_t n_inputs_ = 0;
};

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

void place(const Net::Impl& net, Schedule* schedule) {
  Placer(net, *schedule).run();
}

}  // namespace revisit::engine
