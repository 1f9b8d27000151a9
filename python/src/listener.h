#pragma once

#include <nanobind/nanobind.h>

#include <exception>
#include <type_traits>

#include "revisit/base/error.h"
#include "unlocked.h"

namespace revisit::python {

/// Lets long work of C++ run without the interpreter's lock, and brings to it what Python has to
/// say meanwhile: Ctrl-C, and exceptions of callbacks.
class Listener {
 public:
  /// True when the work is to end.
  bool stop() {
    if (comes_to_nothing()) return true;
    const Locked lock(*unlocked_);
    if (error_) return true;
    if (PyErr_CheckSignals() == 0) return false;
    error_ = std::make_exception_ptr(nanobind::python_error());
    return true;
  }

  /// Calls a function of Python's, unless it is None. What it raises ends the work.
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

  /// Does the work. What Python raised meanwhile comes out in place of its result.
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
      PyErr_SetNone(PyExc_SystemExit);  // which ends a thread silently
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
  /// Whether nobody will look at the result.
  bool comes_to_nothing() const { return interpreter_ends() && !at_end_; }
  void rethrow() const {
    if (error_) std::rethrow_exception(error_);
  }

  Unlocked* unlocked_ = nullptr;            // while the work is done
  std::exception_ptr error_;                // guarded by the interpreter's lock
  const bool at_end_ = interpreter_ends();  // a function of atexit's made this
};

/// Calls `work` without the interpreter's lock. It must not touch objects of Python's.
template <class Work>
auto without_lock(const Work& work) {
  const Unlocked unlocked;
  return work();
}

}  // namespace revisit::python
