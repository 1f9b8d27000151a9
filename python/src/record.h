#pragma once

#include <nanobind/nanobind.h>

#include <string>

#include "revisit/base/error.h"
#include "strings.h"

namespace revisit::python {

namespace nb = nanobind;

template <class T, class Value>
struct Field {
  const char* name;
  Value T::*member;
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
      nb::kw_only(), (nb::arg(fields.name) = defaults.*fields.member)...);
  (bound.def_ro(fields.name, fields.member), ...);
  bound.def("__repr__", [=](const T& record) {
    std::string values;
    ((values += str(values.empty() ? "" : ", ", fields.name, "=", record.*fields.member)), ...);
    return str(name, "(", values, ")");
  });
}

}  // namespace revisit::python
