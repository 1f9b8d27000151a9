#include "layers/broadcast.h"

#include <algorithm>
#include <cmath>

namespace revisit::engine {

Shape trained_operand(const Shape& input, int64_t axis, int64_t num_axes) {
  const size_t first = input.canonical_axis(axis, "axis");
  if (num_axes < -1)
    throw InputError("num_axes must be -1 (all that follow) or more, found ", num_axes);
  const int64_t last =
      num_axes == -1 ? static_cast<int64_t>(input.rank()) : static_cast<int64_t>(first) + num_axes;
  if (last > static_cast<int64_t>(input.rank()))
    throw InputError(num_axes, " axes from axis ", first, " on reach past the input (", input, ")");
  return Shape(std::vector<int64_t>(input.axes().begin() + static_cast<int64_t>(first),
                                    input.axes().begin() + last));
}

ChannelRuns lay_over(const Shape& operand, const Shape& input, int64_t axis) {
  const size_t first = operand.rank() == 0 ? 0 : input.canonical_axis(axis, "axis");
  const size_t last = first + operand.rank();
  bool fits = last <= input.rank();
  for (size_t i = 0; fits && i < operand.rank(); ++i) fits = operand[i] == input[first + i];
  if (!fits)
    throw InputError("the second input (", operand, ") does not match the first (", input,
                     ") from axis ", first, " on");
  return {input.product(0, first), operand.elements(), input.product(last, input.rank())};
}

Form channel_affine(const ChannelRuns& runs, const Shape& input, const std::vector<float>* scale,
                    const std::vector<float>* shift) {
  if (input.rank() < 2) return {};
  const int64_t channels = input[1];
  const bool one_for_all = runs.channels == 1;
  if (!one_for_all &&
      (runs.outer != input[0] || runs.channels != channels || runs.elements() != input.elements()))
    return {};
  // Without loaded weights any values will do.
  const auto spread = [&](const std::vector<float>* values, double absent) {
    std::vector<double> result(channels, absent);
    for (int64_t c = 0; values && !values->empty() && c < channels; ++c)
      result[c] = (*values)[one_for_all ? 0 : c];
    return result;
  };
  ChannelAffine affine{spread(scale, 1), spread(shift, 0)};
  return all_finite(affine) ? Form(std::move(affine)) : Form();
}

bool all_finite(const ChannelAffine& affine) {
  const auto finite = [](double x) { return std::isfinite(x); };
  return std::all_of(affine.scale.begin(), affine.scale.end(), finite) &&
         std::all_of(affine.shift.begin(), affine.shift.end(), finite);
}

}  // namespace revisit::engine
