#include "arrays.h"

#include "module.h"
#include "revisit/base/error.h"
#include "unlocked.h"

namespace revisit::python {

ShapeTuple tuple_of(const std::vector<int64_t>& axes) {
  nb::list list;
  for (const int64_t axis : axes) list.append(axis);
  return nb::borrow<ShapeTuple>(nb::tuple(list));
}

std::string description_of(nb::handle object) {
  const auto text = [](nb::handle value) { return std::string(nb::str(value).c_str()); };
  if (!nb::hasattr(object, "dtype") || !nb::hasattr(object, "shape"))
    return text(object.type().attr("__name__"));
  const std::string device = text(nb::getattr(object, "device", nb::str("cpu")));
  return str(text(object.attr("dtype")), " array of shape ", text(object.attr("shape")),
             device == "cpu" ? "" : " on " + device);
}

std::string name_from(nb::handle key, const char* what) {
  std::string name;
  if (!nb::try_cast(key, name))
    throw type_error(str(what, ": expected a name, found ", description_of(key)));
  return name;
}

bool is_float32(nb::handle dtype) {
  return nb::cast<std::string>(nb::str(dtype)) == "float32";
}

bool is_float64(nb::handle dtype) {
  return nb::cast<std::string>(nb::str(dtype)) == "float64";
}

void refuse_masked(nb::handle object, const std::string& what) {
  if (nb::hasattr(object.type(), "filled") && nb::hasattr(object.type(), "mask"))
    throw type_error(str(what, ": expected an array without mask, found a masked array, ",
                         description_of(object), "; use x.filled(value) or x.data"));
}

GivenArray<float> float_array(nb::handle object, const std::string& what) {
  refuse_masked(object, what);
  GivenArray<float> array;
  if (nb::ndarray_check(object) && nb::try_cast(object, array, false)) return array;
  if (nb::hasattr(object, "__array_interface__") &&
      is_float32(nb::getattr(object, "dtype", nb::none()))) {
    const nb::object copied = nb::module_::import_("numpy").attr("ascontiguousarray");
    return nb::cast<GivenArray<float>>(call(copied, object));
  }
  throw type_error(
      str(what, ": expected a numpy array of float32, found ", description_of(object),
          "; arrays are not converted implicitly: use numpy.asarray(x, numpy.float32)"));
}

std::vector<float> numbers_of(nb::handle object, const std::string& what) {
  const bool is_double = nb::hasattr(object, "__array_interface__") &&
                         is_float64(nb::getattr(object, "dtype", nb::none()));
  if (is_double) refuse_masked(object, what);
  const auto array =
      float_array(is_double ? object.attr("astype")("float32") : nb::borrow(object), what);
  if (array.ndim() != 1)
    throw value_error(str(what, ": expected an array of one axis, found ", description_of(object)));
  std::vector<float> values(array.shape(0));
  for (size_t i = 0; i < values.size(); ++i)
    values[i] = array.data()[static_cast<int64_t>(i) * array.stride(0)];
  return values;
}

GivenArray<float> contiguous_floats(nb::handle object, const std::string& what) {
  auto array = float_array(object, what);
  int64_t step = 1;
  for (size_t axis = array.ndim(); axis-- > 0;) {
    if (array.shape(axis) != 1 && array.size() != 0 && array.stride(axis) != step)
      throw value_error(str(what, ": expected an array in C order, found ", description_of(object),
                            " with other strides; use numpy.ascontiguousarray(x)"));
    step *= static_cast<int64_t>(array.shape(axis));
  }
  return array;
}

}  // namespace revisit::python
