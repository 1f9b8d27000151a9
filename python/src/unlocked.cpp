#include "unlocked.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <optional>
#include <thread>

namespace revisit::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;

// Guarded by the interpreter's lock.
int inside = 0;                      // calls, of all threads
std::optional<std::thread::id> end;  // the thread that ends the interpreter

std::atomic<bool> left = false;  // a signal came, and it does not wait any longer

// Calls of this thread, one inside the other through functions of Python's.
thread_local int depth = 0;

bool ends_here() {
  return end == std::this_thread::get_id();
}

[[noreturn]] void stay() {
  for (;;) ::pause();
}

/// What the frames of other threads use is never let go of: no fault of ours to warn of.
void expect_leaks() {
  nb::set_leak_warnings(false);
}

void wait_for_calls() {
  if (nb::cast<int>(nb::module_::import_("threading").attr("active_count")()) > 1) expect_leaks();
  end = std::this_thread::get_id();
  while (inside > depth) {
    {
      const nb::gil_scoped_release unlocked;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    if (PyErr_CheckSignals() != 0) {
      left = true;
      throw nb::python_error();
    }
  }
}

}  // namespace

Call::Call() {
  if (depth == 0 && end && !ends_here()) {
    PyEval_SaveThread();
    stay();
  }
  ++depth;
  ++inside;
}

Call::~Call() {
  --inside;
  --depth;
}

bool Call::interpreter_ends() {
  return end.has_value();
}

Unlocked::~Unlocked() {
  if (left && !ends_here()) stay();
  PyEval_RestoreThread(state_);
}

void wait_for_calls_at_exit() {
  nb::module_::import_("atexit").attr("register")(nb::cpp_function(&wait_for_calls));
  // Of the threads of a process that forks, the child has one.
  const auto forked = nb::cpp_function([] {
    inside = depth;
    expect_leaks();
  });
  nb::module_::import_("os").attr("register_at_fork")("after_in_child"_a = forked);
}

}  // namespace revisit::python
