#include "revisit/engine/tensor.h"

#include <charconv>
#include <ostream>

#include "revisit/proto/limits.h"

namespace revisit::engine {

Shape::Shape(std::vector<int64_t> axes) : axes_(std::move(axes)) {
  if (rank() > proto::kMaxAxes)
    throw InputError("a shape has ", rank(), " axes; Caffe's limit is ", proto::kMaxAxes);
  int64_t elements = 1;
  for (const int64_t size : axes_) {
    if (size < 1) throw InputError("shape ", text(), " has an axis below 1");
    if (__builtin_mul_overflow(elements, size, &elements) || elements > kMaxElements)
      throw InputError("shape ", text(), " has more than ", kMaxElements, " elements");
  }
}

Shape Shape::parse(std::string_view text) {
  std::vector<int64_t> axes;
  const char* next = text.data();
  const char* const end = text.data() + text.size();
  for (;;) {
    int64_t size = 0;
    const auto [stop, error] = std::from_chars(next, end, size);
    if (error != std::errc() || size < 1 || (stop != end && *stop != 'x' && *stop != ','))
      throw UsageError("expected a shape like 1x3x107x4000, found '", text, "'");
    axes.push_back(size);
    if (stop == end) break;
    next = stop + 1;
  }
  try {
    return Shape(std::move(axes));
  } catch (const InputError& error) {
    throw UsageError(error.what());
  }
}

int64_t Shape::product(size_t begin, size_t end) const {
  int64_t result = 1;
  for (size_t axis = begin; axis < end; ++axis) result *= axes_[axis];
  return result;
}

size_t Shape::canonical_axis(int64_t axis, std::string_view what) const {
  const auto rank_signed = static_cast<int64_t>(rank());
  if (axis < -rank_signed || axis >= rank_signed)
    throw InputError(what, " ", axis, " is out of range for an input of shape ", text());
  return static_cast<size_t>(axis < 0 ? axis + rank_signed : axis);
}

Shape Shape::with(size_t axis, int64_t size) const {
  std::vector<int64_t> axes = axes_;
  axes.at(axis) = size;
  return Shape(std::move(axes));
}

Shape Shape::with_rows(size_t axis, int64_t size) const {
  if (size > 0) return with(axis, size);
  Shape empty = *this;
  empty.axes_.at(axis) = 0;
  return empty;
}

std::ostream& operator<<(std::ostream& out, const Shape& shape) {
  return out << shape.text();
}

}  // namespace revisit::engine
