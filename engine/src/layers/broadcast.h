#pragma once

#include "form.h"
#include "kernels/channels.h"
#include "revisit/engine/tensor.h"

namespace revisit::engine {

/// Takes `num_axes` axes of the input from `axis`; -1: all that follow.
Shape trained_operand(const Shape& input, int64_t axis, int64_t num_axes);

/// Maps `operand` to `input`, with its first axis at `axis`. A scalar matches any axis.
ChannelRuns lay_over(const Shape& operand, const Shape& input, int64_t axis);

/// Returns x * scale + shift as ChannelAffine if `runs` assigns one number to each channel of
/// `input` (or to all); `scale` or `shift` can be null. Returns an empty form for other runs, and
/// for numbers that are not finite, because fused factors would change the results.
Form channel_affine(const ChannelRuns& runs, const Shape& input, const std::vector<float>* scale,
                    const std::vector<float>* shift);

bool all_finite(const ChannelAffine& affine);

}  // namespace revisit::engine
