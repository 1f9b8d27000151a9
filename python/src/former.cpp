#include <nanobind/nanobind.h>

#include <string>

#include "module.h"
#include "strings.h"
#include "unlocked.h"

namespace revisit::python {
namespace {

using namespace nb::literals;

/// Warns of each former name.
nb::kwargs renamed(const nb::dict& names, const nb::kwargs& given, const std::string& function) {
  nb::dict current;
  for (const auto& [key, value] : given) {
    const nb::object name = names.contains(key) ? nb::object(names[key]) : nb::borrow(key);
    if (!name.is(key) && given.contains(name))
      throw type_error(function + "(): got multiple values for argument '" +
                       nb::cast<std::string>(name) + "'");
    current[name] = value;
    if (name.is(key)) continue;
    const std::string message = function + "(): '" + nb::cast<std::string>(key) +
                                "' is deprecated; use '" + nb::cast<std::string>(name) + "'";
    const int failed = giving_the_lock_away(
        [&] { return PyErr_WarnEx(PyExc_DeprecationWarning, message.c_str(), 1); });
    if (failed) throw nb::python_error();
  }
  return nb::borrow<nb::kwargs>(current);
}

bool has_any(const nb::dict& names, const nb::kwargs& given) {
  for (const auto& [key, value] : given)
    if (names.contains(key)) return true;
  return false;
}

/// Adds an overload for calls with former names, which calls the others with the current ones.
void accept_former_keywords(const nb::object& scope, const std::string& function,
                            const nb::dict& names) {
  const std::string signature = "def " + function + "(**former_names)";
  const std::string shown =
      function == "__init__" ? nb::cast<std::string>(scope.attr("__name__")) : function;
  // Borrows the scope, because it owns the function.
  const auto forward = [scope = nb::handle(scope), function, names, shown](const auto& kwargs,
                                                                           const auto&... first) {
    if (!has_any(names, kwargs)) throw nb::next_overload();
    return scope.attr(function.c_str())(first..., **renamed(names, kwargs, shown));
  };
  const nb::object known = scope.attr(function.c_str());
  if (std::string(nb::type_name(known.type()).c_str()).ends_with("nb_method"))
    nb::cpp_function([forward](nb::handle self, const nb::args& args,
                               const nb::kwargs& kwargs) { return forward(kwargs, self, *args); },
                     nb::scope(scope), nb::sig(signature.c_str()), nb::is_method());
  else
    nb::cpp_function([forward](const nb::args& args,
                               const nb::kwargs& kwargs) { return forward(kwargs, *args); },
                     nb::scope(scope), nb::sig(signature.c_str()));
}

}  // namespace

void bind_former_names(nb::module_& core) {
  core.def("_accept_former_keywords", &accept_former_keywords, "scope"_a, "function"_a, "names"_a);
}

}  // namespace revisit::python
