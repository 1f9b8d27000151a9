#pragma once

#include "schedule.h"

namespace revisit::engine {

/// Places a schedule in the arena. Values can share buffers (views, in-place outputs, inputs of a
/// Concat in its output), and buffers share the arena over time. Pinned values are never
/// overwritten.
void place(const Net::Impl& net, Schedule* schedule);

}  // namespace revisit::engine
