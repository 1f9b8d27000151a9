#pragma once

#include "kernels/channels.h"
#include "revisit/engine/tensor.h"

/// What Scale and Bias share: an operand that covers some axes of the input.
namespace revisit::engine {

/// Shape of a learned operand: `num_axes` axes of the input from `axis` on; -1: all that follow.
Shape learned_operand(const Shape& input, int64_t axis, int64_t num_axes);

/// How `operand` lies on `input`, its first axis on `axis`. A single number lies anywhere.
ChannelRuns lay_over(const Shape& operand, const Shape& input, int64_t axis);

}  // namespace revisit::engine
