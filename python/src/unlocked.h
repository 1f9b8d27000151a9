#pragma once

#include <cxxabi.h>
#include <nanobind/nanobind.h>

#include <atomic>

/// Work of C++ without the interpreter's lock, which other threads then have.
///
/// When the interpreter ends, CPython before 3.14 ends every other thread that asks for the lock,
/// by unwinding its frames, ours among them. So a thread that asks for it in here stays where it is
/// instead, as it does from 3.14 on. And the process waits before it ends until none is in C++.
namespace revisit::python {

/// Whether it has begun to end: the work of other threads is to stop.
bool interpreter_ends();

/// Gives the lock away.
class Unlocked {
 public:
  Unlocked();
  ~Unlocked();
  Unlocked(const Unlocked&) = delete;
  Unlocked& operator=(const Unlocked&) = delete;

 private:
  friend class Locked;
  void leave();  // C++, for Python: one of its threads
  void enter();
  std::atomic<int> in_python_ = 0;
  PyThreadState* state_;
};

/// Has the lock within an Unlocked, in any thread of its, to call functions of Python's: nobody
/// waits for these.
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

[[noreturn]] void stay();

/// Does what asks for the lock by itself. `work` must make no objects: the destructors of what it
/// made would run without the lock when the thread is ended in there.
template <class Work>
auto giving_the_lock_away(const Work& work) {
  try {
    return work();
  } catch (const abi::__forced_unwind&) {
    stay();
  }
}

/// Calls a function of Python's that may give the lock away: numpy after it has copied, a callback.
template <class... Arguments>
nanobind::object call(nanobind::handle function, const Arguments&... arguments) {
  PyObject* const result = giving_the_lock_away([&] {
    return PyObject_CallFunctionObjArgs(function.ptr(), arguments.ptr()...,
                                        static_cast<PyObject*>(nullptr));
  });
  if (!result) throw nanobind::python_error();
  return nanobind::steal(result);
}

/// To be called when the module is made.
void wait_for_threads_at_exit();

}  // namespace revisit::python
