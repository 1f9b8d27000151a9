#pragma once

#include "memory_plan.h"
#include "schedule.h"

namespace revisit::engine {

/// Where everything of a schedule lies in the arena, in floats from its start.
struct Placement {
  std::vector<int64_t> stored;          // as Schedule::stored
  std::vector<int64_t> scratch, state;  // as Schedule::steps
  std::vector<bool> runs;               // as Schedule::steps: false where nothing has to be done
  std::vector<int64_t> new_floats;      // as Schedule::steps: memory that its outputs take anew
  std::vector<BufferUse> buffers;       // for people
  int64_t arena_floats = 0;
};

/// Lets values share buffers (views, work in place, inputs of a Concat that lie in its output) and
/// buffers share the arena over time. Pinned values are never overwritten.
Placement place(const Net::Impl& net, const Schedule& schedule);

}  // namespace revisit::engine
