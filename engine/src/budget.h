#pragma once

#include <vector>

#include "plan_impl.h"

namespace revisit::engine {

// What a few lines of prototxt can ask for has no bounds: these are checked before anything is
// allocated. The errors name the layer, the limit and what to do.

constexpr int64_t kMegabyte = 1 << 20;  // of messages

void check_weight_bytes(const Net::Impl& net, int64_t limit);

/// The outputs of one layer are alive together. Throws with a reason only, as Layer does.
void check_outputs(const std::vector<Shape>& outputs, int64_t limit);

/// Of a plan whose schedule is placed.
void check_run_memory(const Plan::Impl& plan, int64_t limit);

/// Throws UsageError for fewer than one or too many.
void check_threads(int threads);

}  // namespace revisit::engine
