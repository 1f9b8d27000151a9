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

/// Calls in C++, without the lock.
std::atomic<int> working = 0, working_since_the_end = 0;

void sleep_a_moment() {
  std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

/// What the frames of other threads use is never let go of: no fault of ours to warn of.
void expect_leaks() {
  nb::set_leak_warnings(false);
}

/// The work of other threads ends, if it asks. What they begin from now on is not waited for: one
/// may begin again and again.
void wait_for_calls() {
  if (nb::cast<int>(nb::module_::import_("threading").attr("active_count")()) > 1) expect_leaks();
  ends = true;
  while (working > 0) {
    {
      const nb::gil_scoped_release unlocked;
      sleep_a_moment();
    }
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
  }
}

/// The process ends, and what is static with it.
void wait_for_threads() {
  has_ended = true;
  while (working > 0 || working_since_the_end > 0) sleep_a_moment();
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
  if (has_ended) leave_for_ever();
  try {
    return take();
  } catch (const abi::__forced_unwind&) {
    leave_for_ever();
  }
}

Unlocked::Unlocked()
    : working_(ends ? working_since_the_end : working), state_(PyEval_SaveThread()) {
  ++working_;
}

Unlocked::~Unlocked() {
  locked_by([this] { PyEval_RestoreThread(state_); });
  leave();
}

void Unlocked::leave() {
  if (in_python_++ == 0) --working_;
}

void Unlocked::enter() {
  if (--in_python_ == 0) ++working_;
}

void Unlocked::leave_for_ever() {
  leave();
  stay();
}

Locked::Locked(Unlocked& call) : call_(call), state_(call.locked_by(PyGILState_Ensure)) {
  call_.leave();
}

Locked::~Locked() {
  call_.enter();
  PyGILState_Release(state_);
  if (has_ended) call_.leave_for_ever();
}

void wait_for_calls_at_exit() {
  nb::module_::import_("atexit").attr("register")(nb::cpp_function(&wait_for_calls));
  Py_AtExit(wait_for_threads);
  // Of the threads of a process that forks, the child has one.
  const auto forked = nb::cpp_function([] {
    working = working_since_the_end = 0;
    expect_leaks();
  });
  nb::module_::import_("os").attr("register_at_fork")("after_in_child"_a = forked);
}

}  // namespace revisit::python
