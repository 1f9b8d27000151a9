#pragma once

#include <cxxabi.h>
#include <nanobind/nanobind.h>

#include <atomic>

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

/// Calls a Python function that may release the GIL: numpy after a copy, a callback.
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

}  // namespace revisit::python
