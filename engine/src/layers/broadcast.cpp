#include "layers/broadcast.h"

namespace revisit::engine {

Shape learned_operand(const Shape& input, int64_t axis, int64_t num_axes) {
  const size_t first = input.canonical_axis(axis, "axis");
  if (num_axes < -1)
    throw InputError(str("num_axes must be -1 (all that follow) or more, found ", num_axes));
  const int64_t last =
      num_axes == -1 ? static_cast<int64_t>(input.rank()) : static_cast<int64_t>(first) + num_axes;
  if (last > static_cast<int64_t>(input.rank()))
    throw InputError(
        str(num_axes, " axes from axis ", first, " on reach past the input (", input, ")"));
  return Shape(std::vector<int64_t>(input.axes().begin() + static_cast<int64_t>(first),
                                    input.axes().begin() + last));
}

ChannelRuns lay_over(const Shape& operand, const Shape& input, int64_t axis) {
  const size_t first = operand.rank() == 0 ? 0 : input.canonical_axis(axis, "axis");
  const size_t last = first + operand.rank();
  bool fits = last <= input.rank();
  for (size_t i = 0; fits && i < operand.rank(); ++i) fits = operand[i] == input[first + i];
  if (!fits)
    throw InputError(str("the second input (", operand, ") does not match the first (", input,
                         ") from axis ", first, " on"));
  return {input.product(0, first), operand.elements(), input.product(last, input.rank())};
}

}  // namespace revisit::engine
