#pragma once

#include <cxxabi.h>
#include <nanobind/nanobind.h>

#include <atomic>
#include <exception>

#include "revisit/base/error.h"

/// At interpreter shutdown, CPython before 3.14 ends every other thread that requests the GIL by
/// unwinding its frames, including ours. Such a thread blocks here instead, as with CPython 3.14.
/// The process waits at exit until no thread is in C++.
namespace revisit::python {

/// True once shutdown has begun: the work of other threads must stop.
bool interpreter_ends();

/// Releases the GIL.
class Unlocked {
 public:
  Unlocked();
  ~Unlocked();
  Unlocked(const Unlocked&) = delete;
  Unlocked& operator=(const Unlocked&) = delete;

 private:
  friend class Locked;
  void leave();  // a thread of this call goes from C++ to Python
  void enter();
  std::atomic<int> in_python_ = 0;
  PyThreadState* state_;
};

/// Acquires the GIL within an Unlocked, in any of its threads, to call Python functions. Process
/// exit does not wait for these.
class Locked {
 public:
  explicit Locked(Unlocked& call);
  ~Locked();
  Locked(const Locked&) = delete;
  Locked& operator=(const Locked&) = delete;

 private:
  Unlocked& call_;
  PyGILState_STATE state_;
};

/// Blocks this thread until the process exits.
[[noreturn]] void stay();

/// Runs work that acquires the GIL itself. `work` must create no objects, because their destructors
/// would run without the GIL if CPython ended the thread in there.
template <class Work>
auto giving_the_lock_away(const Work& work) {
  try {
    return work();
  } catch (const abi::__forced_unwind&) {
    stay();
  }
}

/// Calls a Python function that may release the GIL, as numpy does after a copy.
template <class... Arguments>
nanobind::object call(nanobind::handle function, const Arguments&... arguments) {
  PyObject* const result = giving_the_lock_away([&] {
    return PyObject_CallFunctionObjArgs(function.ptr(), arguments.ptr()...,
                                        static_cast<PyObject*>(nullptr));
  });
  if (!result) throw nanobind::python_error();
  return nanobind::steal(result);
}

/// Must be called once, when the module is created.
void wait_for_threads_at_exit();

/// Runs long C++ work without the GIL and stops it after Ctrl-C.
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

  /// Throws the pending exception of Python, if any, instead of returning.
  template <class Work>
  auto run(const Work& work) {
    try {
      auto result = released(work);
      rethrow();
      return result;
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
