#pragma once

#include "kernels/channels.h"
#include "kernels/epilogue.h"

namespace revisit::engine {

/// What blocked kernels do while results are in registers, for kernels that do not: adds `addend`
/// (or nothing, when null) to `values` and activates them, in place.
void add_and_activate(const ChannelRuns& runs, const Epilogue& epilogue, const float* addend,
                      int threads, float* values);

}  // namespace revisit::engine
