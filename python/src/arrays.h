#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "revisit/engine/tensor.h"

/// Arrays of numbers between C++ and numpy, without copies.
namespace revisit::python {

namespace nb = nanobind;

using ShapeTuple = nb::typed<nb::tuple, int, nb::ellipsis>;
using FloatArray = nb::ndarray<nb::numpy, float>;
using ReadOnlyFloats = nb::ndarray<nb::numpy, const float>;
/// What somebody gave. Without a device nanobind takes arrays of a GPU, too.
template <class T, class... Rules>
using GivenArray = nb::ndarray<nb::numpy, const T, nb::device::cpu, Rules...>;

/// An argument for float_array(): what else is given there is refused by its message.
using GivenFloats = nb::typed<nb::handle, FloatArray>;

/// (1, 3, 227, 227)
ShapeTuple tuple_of(const std::vector<int64_t>& axes);

inline std::string_view bytes_of(const nb::bytes& bytes) {
  return {static_cast<const char*>(bytes.data()), bytes.size()};
}

/// An array of numpy's that refers to `data` and keeps `owner` alive.
template <class T>
nb::ndarray<nb::numpy, T> view_of(T* data, const std::vector<int64_t>& shape, nb::handle owner) {
  const std::vector<size_t> sizes(shape.begin(), shape.end());
  return nb::ndarray<nb::numpy, T>(data, sizes.size(), sizes.data(), owner);
}

/// An array of numpy's that owns `values` from now on.
template <class T>
nb::ndarray<nb::numpy, T> array_of(std::vector<T> values, const std::vector<int64_t>& shape) {
  auto* kept = new std::vector<T>(std::move(values));
  const nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return view_of(kept->data(), shape, owner);
}

/// "float64 array of shape (3, 227)", "list": what was found where an array was expected.
std::string description_of(nb::handle object);

/// The name that somebody gave as a key. Throws TypeError for anything but text.
std::string name_from(nb::handle key, const char* what);

/// Of numpy's types.
bool is_float32(nb::handle dtype);

/// Throws TypeError for a masked array of numpy's: the numbers behind the mask would count.
void refuse_masked(nb::handle object, const std::string& what);

/// What somebody gave as an array of float32, with any strides; a copy where these are no multiple
/// of 4 bytes. `what` begins the message of the TypeError for anything else: nothing is converted.
GivenArray<float> float_array(nb::handle object, const std::string& what);
/// The same, in C order: ValueError for strides that float_array() does not copy.
GivenArray<float> contiguous_floats(nb::handle object, const std::string& what);

/// The axes of an array.
template <class Array>
std::vector<int64_t> shape_of(const Array& array) {
  std::vector<int64_t> shape(array.ndim());
  for (size_t i = 0; i < shape.size(); ++i) shape[i] = static_cast<int64_t>(array.shape(i));
  return shape;
}

}  // namespace revisit::python
