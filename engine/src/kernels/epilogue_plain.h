#pragma once

#include "kernels/channels.h"
#include "kernels/epilogue.h"

namespace revisit::engine {

/// What blocked kernels do while results are in registers, for kernels that do not.
struct PlainEpilogue {
  const float* scale = nullptr;  // [channels]; null: 1
  const float* shift = nullptr;  // [channels], there when scale is
  const float* addend = nullptr;
  Epilogue epilogue = {};
};

/// Finishes `values` in place: scale and shift, addend, activation.
void finish(const ChannelRuns& runs, const PlainEpilogue& epilogue, int threads, float* values);

}  // namespace revisit::engine
