#pragma once

#include "form.h"
#include "kernels/channel_runs.h"
#include "revisit/engine/tensor.h"

/// What Scale and Bias share: an operand that covers some axes of the input.
namespace revisit::engine {

/// Shape of a learned operand: `num_axes` axes of the input from `axis` on; -1: all that follow.
Shape learned_operand(const Shape& input, int64_t axis, int64_t num_axes);

/// How `operand` lies on `input`, its first axis on `axis`. A single number lies anywhere.
ChannelRuns lay_over(const Shape& operand, const Shape& input, int64_t axis);

/// x * scale + shift as ChannelAffine, where `runs` gives every channel of `input` (or all of them)
/// one number; without `scale` or `shift` the other alone. Nothing for other runs, nor for numbers
/// that are not finite: factors of weights would not give what factors of sums give.
Form channel_affine(const ChannelRuns& runs, const Shape& input, const std::vector<float>* scale,
                    const std::vector<float>* shift);

bool all_finite(const ChannelAffine& affine);

}  // namespace revisit::engine
