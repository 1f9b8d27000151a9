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

namespace revisit::python {

namespace nb = nanobind;

using ShapeTuple = nb::typed<nb::tuple, int, nb::ellipsis>;
using FloatArray = nb::ndarray<nb::numpy, float>;
using ReadOnlyFloats = nb::ndarray<nb::numpy, const float>;
/// Names the device, because nanobind would accept GPU arrays, too.
template <class T, class... Rules>
using GivenArray = nb::ndarray<nb::numpy, const T, nb::device::cpu, Rules...>;

/// Argument type for float_array(), which reports all type errors itself.
using GivenFloats = nb::typed<nb::handle, FloatArray>;

ShapeTuple tuple_of(const std::vector<int64_t>& axes);

inline std::string_view bytes_of(const nb::bytes& bytes) {
  return {static_cast<const char*>(bytes.data()), bytes.size()};
}

/// Refers to `data` and keeps `owner` alive.
template <class T>
nb::ndarray<nb::numpy, T> view_of(T* data, const std::vector<int64_t>& shape, nb::handle owner) {
  const std::vector<size_t> sizes(shape.begin(), shape.end());
  return nb::ndarray<nb::numpy, T>(data, sizes.size(), sizes.data(), owner);
}

/// Refers to `values` and keeps `owner`, which owns them, alive.
inline ReadOnlyFloats view_of(const std::vector<float>& values, nb::handle owner) {
  return view_of(values.data(), {static_cast<int64_t>(values.size())}, owner);
}

/// Owns `values`.
template <class T>
nb::ndarray<nb::numpy, T> array_of(std::vector<T> values, const std::vector<int64_t>& shape) {
  auto* kept = new std::vector<T>(std::move(values));
  const nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return view_of(kept->data(), shape, owner);
}
template <class T>
nb::ndarray<nb::numpy, T> array_of(std::vector<T> values) {
  const auto count = static_cast<int64_t>(values.size());
  return array_of(std::move(values), {count});
}

/// For error messages: "float64 array of shape (3, 227)", or a type's name.
std::string description_of(nb::handle object);

/// Throws TypeError for a key that is not text.
std::string name_from(nb::handle key, const char* what);

bool is_float32(nb::handle dtype);
bool is_float64(nb::handle dtype);

/// Throws TypeError for a masked array, because masked values would be used.
void refuse_masked(nb::handle object, const std::string& what);

/// Returns a float32 array with any strides; a copy if these are no multiple of 4 bytes. Throws
/// TypeError for other types, which are not converted; `what` begins the message.
GivenArray<float> float_array(nb::handle object, const std::string& what);
/// float32 or float64 [n]. Throws as float_array(), and ValueError for another shape.
std::vector<float> numbers_of(nb::handle object, const std::string& what);
/// Like float_array(), in C order. Throws ValueError for other strides.
GivenArray<float> contiguous_floats(nb::handle object, const std::string& what);

template <class Array>
std::vector<int64_t> shape_of(const Array& array) {
  std::vector<int64_t> shape(array.ndim());
  for (size_t i = 0; i < shape.size(); ++i) shape[i] = static_cast<int64_t>(array.shape(i));
  return shape;
}

}  // namespace revisit::python
