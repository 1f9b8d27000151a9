#pragma once

#include "schedule.h"

namespace revisit::engine {

/// Places values in the arena. They can share buffers (views, in-place outputs, inputs of a Concat
/// in its output), also over time. Pinned values are never overwritten.
void place(const Net::Impl& net, Schedule* schedule);

}  // namespace revisit::engine
