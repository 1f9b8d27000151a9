#include <new>
#include <string_view>

#include "module.h"
#include "revisit/base/error.h"
#include "revisit/engine/net.h"
#include "strings.h"
#include "unlocked.h"

namespace revisit::python {
namespace {

/// Makes the exception of this name in revisit/errors.py the pending one of Python's. Names of
/// files and layers in the message may be any bytes.
void raise(const char* name, std::string_view message) {
  try {
    PyErr_SetObject(nb::module_::import_("revisit.errors").attr(name).ptr(),
                    text_of(message).ptr());
  } catch (nb::python_error& error) {  // the interpreter is going down
    error.restore();
  }
}

}  // namespace

void translate_errors() {
  nb::register_exception_translator([](const std::exception_ptr& thrown, void*) {
    if (!thrown) stay();  // CPython ends this thread
    try {
      std::rethrow_exception(thrown);
    } catch (const engine::MemoryError& error) {
      raise("MemoryError", error.what());
    } catch (const UsageError& error) {
      raise("UsageError", error.what());
    } catch (const InputError& error) {
      raise("InputError", error.what());
    } catch (const UnsupportedError& error) {
      raise("UnsupportedError", error.what());
    } catch (const Interrupted& error) {
      raise("Interrupted", error.what());
    } catch (const Error& error) {
      raise("Error", error.what());
    } catch (const nb::cast_error&) {
      PyErr_SetString(PyExc_TypeError, "an argument has an unexpected type");
    } catch (const std::bad_alloc&) {
      raise("MemoryError", "the system has no memory left");
    }
  });
}

}  // namespace revisit::python
