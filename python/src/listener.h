#pragma once

#include <nanobind/nanobind.h>

#include <exception>
#include <type_traits>

#include "revisit/base/error.h"
#include "unlocked.h"

namespace revisit::python {

/// Runs long C++ work without the GIL and stops it after Ctrl-C or an exception of a callback.
class Listener {
 public:
  bool stop() {
    if (comes_to_nothing()) return true;
    const Locked lock(*unlocked_);
    if (error_) return true;
    if (PyErr_CheckSignals() == 0) return false;
    error_ = std::make_exception_ptr(nanobind::python_error());
    return true;
  }

  /// An exception from the callback stops the work.
  template <class... Arguments>
  void tell(const nanobind::object& callback, const Arguments&... arguments) {
    if (callback.is_none() || comes_to_nothing()) return;
    const Locked lock(*unlocked_);
    if (error_) return;
    try {
      call(callback, nanobind::cast(arguments)...);
    } catch (const nanobind::python_error&) {
      error_ = std::current_exception();
    }
  }

  /// Throws the pending exception of Python, if any, instead of returning.
  template <class Work>
  auto run(const Work& work) {
    try {
      if constexpr (std::is_void_v<decltype(work())>) {
        released(work);
        rethrow();
      } else {
        auto result = released(work);
        rethrow();
        return result;
      }
    } catch (const Interrupted&) {
      rethrow();
      if (!comes_to_nothing()) throw;
      PyErr_SetNone(PyExc_SystemExit);  // ends a thread silently
      throw nanobind::python_error();
    }
  }

 private:
  template <class Work>
  auto released(const Work& work) {
    Unlocked unlocked;
    unlocked_ = &unlocked;
    return work();
  }
  /// True if the interpreter is shutting down, because the result is then discarded.
  bool comes_to_nothing() const { return interpreter_ends() && !at_end_; }
  void rethrow() const {
    if (error_) std::rethrow_exception(error_);
  }

  Unlocked* unlocked_ = nullptr;            // set during the work
  std::exception_ptr error_;                // guarded by the GIL
  const bool at_end_ = interpreter_ends();  // created in an atexit function
};

/// Calls `work` without the GIL. It must not touch Python objects.
template <class Work>
auto without_lock(const Work& work) {
  const Unlocked unlocked;
  return work();
}

}  // namespace revisit::python
