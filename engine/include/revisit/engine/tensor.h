#pragma once

#include <cstdint>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit::engine {

/// Number format of values between layers.
enum class Precision {
  kFloat32,  ///< 32-bit floats
  /// bfloat16, the upper 16 bits of a float32, for values between NCHWc kernels and the weights of
  /// their matrix products. Sums, normalization, Winograd's algorithm and all NCHW values
  /// (including inputs and outputs of the net) stay in float32.
  kBf16,
};

/// Size of a tensor, slowest axis first; `[n][c][h][w]` for images. Up to 32 axes, Caffe's limit; a
/// scalar has none. Their product is at most kMaxElements, checked on construction.
class Shape {
 public:
  static constexpr int64_t kMaxElements = INT32_MAX;  ///< Caffe's own limit

  Shape() = default;  ///< of a scalar
  /// Throws InputError for an axis below 1, too many axes, or too many elements.
  Shape(std::initializer_list<int64_t> axes) : Shape(std::vector<int64_t>(axes)) {}
  explicit Shape(std::vector<int64_t> axes);  ///< throws likewise

  /// Parses "1x3x107x4000" or "1,3,107,4000". Throws UsageError.
  static Shape parse(std::string_view text);

  size_t rank() const { return axes_.size(); }                   ///< number of axes
  int64_t operator[](size_t axis) const { return axes_[axis]; }  ///< unchecked
  const std::vector<int64_t>& axes() const { return axes_; }     ///< their sizes
  int64_t elements() const { return product(0, rank()); }        ///< 1 for a scalar
  /// Product of the axes [begin, end).
  int64_t product(size_t begin, size_t end) const;
  /// Resolves Caffe's axis index; negative ones count from the end. Throws InputError with `what`.
  size_t canonical_axis(int64_t axis, std::string_view what) const;
  Shape with(size_t axis, int64_t size) const;  ///< this shape with another size of one axis
  /// Allows size 0, for data-dependent numbers of rows.
  Shape with_rows(size_t axis, int64_t size) const;
  /// "1x3x107x4000"; "()" without axes.
  std::string text() const { return shape_text(axes_); }

  friend bool operator==(const Shape&, const Shape&) = default;

 private:
  std::vector<int64_t> axes_;
};

std::ostream& operator<<(std::ostream& out, const Shape& shape);  ///< writes text()

/// Non-owning view of values in C order.
template <class T>
struct View {
  T* data = nullptr;  ///< first value
  Shape shape;        ///< number of values: shape.elements()
  /// All values.
  std::span<T> values() const { return {data, static_cast<size_t>(shape.elements())}; }
};

}  // namespace revisit::engine
