#pragma once

#include "schedule.h"

namespace revisit::engine {

/// Says where everything of a schedule lies in the arena. Lets values share buffers (views, work in
/// place, inputs of a Concat that lie in its output) and buffers share the arena over time. Pinned
/// values are never overwritten.
void place(const Net::Impl& net, Schedule* schedule);

}  // namespace revisit::engine
