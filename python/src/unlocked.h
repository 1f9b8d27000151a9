#pragma once

#include <nanobind/nanobind.h>

namespace revisit::python {

/// A call of ours that lets other threads have the interpreter's lock meanwhile. A thread that asks
/// for it when the interpreter has ended is ended in the middle of C++, or never comes back. So the
/// interpreter waits, before it ends, until no call is inside, and a call that begins afterwards in
/// another thread than the one that ends it stays here for ever. Made and destroyed with the lock.
class Call {
 public:
  Call();
  ~Call();
  Call(const Call&) = delete;
  Call& operator=(const Call&) = delete;

  /// Whether the interpreter waits for the calls that are inside.
  static bool interpreter_ends();
};

/// A call that gives the lock away until it ends.
class Unlocked {
 public:
  Unlocked() : state_(PyEval_SaveThread()) {}
  ~Unlocked();
  Unlocked(const Unlocked&) = delete;
  Unlocked& operator=(const Unlocked&) = delete;

 private:
  Call call_;
  PyThreadState* state_;
};

/// Makes the interpreter wait, to be called when the module is made.
void wait_for_calls_at_exit();

}  // namespace revisit::python
