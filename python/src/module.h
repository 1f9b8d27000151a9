#pragma once

#include <nanobind/nanobind.h>

#include <string>
#include <string_view>

#include "revisit/base/error.h"

/// Conversion of text between C++ and Python, instead of <nanobind/stl/string.h>. Names of files,
/// layers and drives may be arbitrary bytes, which are decoded as by os.fsdecode().
namespace revisit::python {

inline nanobind::str text_of(std::string_view text) {
  return nanobind::steal<nanobind::str>(
      PyUnicode_DecodeUTF8(text.data(), static_cast<Py_ssize_t>(text.size()), "surrogateescape"));
}

/// Raises a Python exception. nb::type_error() would lose a message that is not UTF-8.
inline nanobind::python_error error_of(PyObject* type, std::string_view message) {
  PyErr_SetObject(type, text_of(message).ptr());
  return {};
}
inline nanobind::python_error type_error(std::string_view message) {
  return error_of(PyExc_TypeError, message);
}
inline nanobind::python_error value_error(std::string_view message) {
  return error_of(PyExc_ValueError, message);
}

}  // namespace revisit::python

namespace nanobind::detail {

template <>
struct type_caster<std::string> {
  NB_TYPE_CASTER(std::string, const_name("str"))

  bool from_python(handle src, uint32_t, cleanup_list*) noexcept {
    if (!PyUnicode_Check(src.ptr())) return false;
    const object bytes = steal(PyUnicode_AsEncodedString(src.ptr(), "utf-8", "surrogateescape"));
    if (!bytes.is_valid()) {
      PyErr_Clear();
      return false;
    }
    value.assign(PyBytes_AsString(bytes.ptr()), static_cast<size_t>(PyBytes_Size(bytes.ptr())));
    return true;
  }

  static handle from_cpp(const std::string& text, rv_policy, cleanup_list*) noexcept {
    return revisit::python::text_of(text).release();
  }
};

}  // namespace nanobind::detail

namespace revisit::python {

namespace nb = nanobind;

void translate_errors();
void bind_proto(nb::module_& module);
void bind_engine(nb::module_& module);
#ifdef REVISIT_HAVE_PIPELINE
void bind_recognition(nb::module_& module);
void bind_features(nb::module_& module);
void bind_pca(nb::module_& module);
void bind_datasets(nb::module_& module);
void bind_evaluation(nb::module_& module);
void bind_maps(nb::module_& module);
void bind_registration(nb::module_& module);
#endif

template <class T, class Value>
struct Field {
  const char* name;
  Value T::*member;
  const char* doc;
};

/// The constructor takes keywords with T's defaults. `check(record)` throws for invalid values.
template <class T, class Check, class... Values>
void bind_record(nb::module_& module, const char* name, const char* doc, const Check& check,
                 const Field<T, Values>&... fields) {
  const T defaults;
  nb::class_<T> bound(module, name, doc);
  bound.def(
      "__init__",
      [=](T* self, Values... values) {
        T record;
        ((record.*fields.member = values), ...);
        check(record);
        new (self) T(record);
      },
      nb::kw_only(), (nb::arg(fields.name) = defaults.*fields.member)...,
      "Raises UsageError for invalid values, here or where the record is used.");
  (bound.def_ro(fields.name, fields.member, fields.doc), ...);
  bound.def("__repr__", [=](const T& record) {
    std::string values;
    ((values += str(values.empty() ? "" : ", ", fields.name, "=", record.*fields.member)), ...);
    return str(name, "(", values, ")");
  });
}

}  // namespace revisit::python
