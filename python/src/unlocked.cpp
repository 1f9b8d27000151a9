#include "unlocked.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <thread>

namespace revisit::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;

std::atomic<bool> ends = false;
std::atomic<bool> has_ended = false;  // there is no lock any more
std::atomic<bool> interrupted = false;

/// Calls in C++ that began before the interpreter began to end, and since.
CallCount before_the_end, since_the_end;

void sleep_a_moment() {
  std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

/// What the frames of other threads use is never let go of: no fault of ours to warn of.
void expect_leaks() {
  nb::set_leak_warnings(false);
}

/// The work of other threads ends, if it asks. What they begin from now on is not waited for here:
/// one may begin again and again.
void wait_for_calls() {
  if (nb::cast<int>(nb::module_::import_("threading").attr("active_count")()) > 1) expect_leaks();
  ends = true;
  while (before_the_end.working > 0 || before_the_end.asking > 0) {
    {
      const nb::gil_scoped_release unlocked;
      sleep_a_moment();
    }
    if (PyErr_CheckSignals() != 0) {
      interrupted = true;
      throw nb::python_error();
    }
  }
}

/// The process ends, and what is static with it. Who asks for the lock now is not heard of again.
void wait_for_threads() {
  has_ended = true;
  while (!interrupted && (before_the_end.working > 0 || since_the_end.working > 0))
    sleep_a_moment();
}

}  // namespace

bool interpreter_ends() {
  return ends;
}

void stay() {
  for (;;) ::pause();
}

template <class Take>
auto Unlocked::locked_by(const Take& take) {
  ++count_.asking;
  leave();
  if (has_ended) stay();
  const auto taken = giving_the_lock_away(take);
  --count_.asking;
  return taken;
}

Unlocked::Unlocked() : count_(ends ? since_the_end : before_the_end) {
  ++count_.working;
  state_ = PyEval_SaveThread();
}

Unlocked::~Unlocked() {
  locked_by([this] {
    PyEval_RestoreThread(state_);
    return true;
  });
}

void Unlocked::leave() {
  if (in_python_++ == 0) --count_.working;
}

void Unlocked::enter() {
  if (--in_python_ == 0) ++count_.working;
}

Locked::Locked(Unlocked& call) : call_(call), state_(call.locked_by(PyGILState_Ensure)) {}

Locked::~Locked() {
  call_.enter();
  PyGILState_Release(state_);
  if (!has_ended) return;
  call_.leave();
  stay();
}

void wait_for_calls_at_exit() {
  nb::module_::import_("atexit").attr("register")(nb::cpp_function(&wait_for_calls));
  Py_AtExit(wait_for_threads);
  // Of the threads of a process that forks, the child has one.
  const auto forked = nb::cpp_function([] {
    for (CallCount* count : {&before_the_end, &since_the_end}) count->working = count->asking = 0;
    expect_leaks();
  });
  nb::module_::import_("os").attr("register_at_fork")("after_in_child"_a = forked);
}

}  // namespace revisit::python
