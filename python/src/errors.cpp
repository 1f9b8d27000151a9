#include <new>
#include <string_view>

#include "module.h"
#include "revisit/base/error.h"
#include "revisit/engine/net.h"
#include "strings.h"
#include "unlocked.h"

namespace revisit::python {
namespace {

/// `name`: class of revisit/errors.py. `message` may hold arbitrary bytes from names of files.
void raise(const char* name, std::string_view message) {
  try {
    PyErr_SetObject(nb::module_::import_("revisit.errors").attr(name).ptr(),
                    text_of(message).ptr());
  } catch (nb::python_error& error) {  // the interpreter is shutting down
    error.restore();
  }
}

}  // namespace

void translate_errors() {
  nb::register_exception_translator([](const std::exception_ptr& thrown, void*) {
    if (!thrown) stay();  // CPython is ending this thread
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
      raise("MemoryError", "out of memory");
    }
  });
}

}  // namespace revisit::python
