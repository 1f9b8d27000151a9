#pragma once

#include <vector>

#include "plan_impl.h"

namespace revisit::engine {

// Limits that are checked before allocation, because a short prototxt can request any amount.
// Errors name the layer, the limit and the fix.

constexpr int64_t kMegabyte = 1 << 20;

void check_weight_bytes(const Net::Impl& net, int64_t limit);

/// Checks the outputs of one layer together. The error has only a reason, as in Layer.
void check_outputs(const std::vector<Shape>& outputs, int64_t limit);

/// Checks a plan whose schedule is placed.
void check_run_memory(const Plan::Impl& plan, int64_t limit);

void check_threads(int threads);

}  // namespace revisit::engine
