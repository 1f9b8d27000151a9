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
std::atomic<bool> has_ended = false;  // the GIL no longer exists
std::atomic<int> working = 0;         // calls with no thread in Python

/// Disables leak warnings, because frames of other threads never release their objects.
void expect_leaks() {
  nb::set_leak_warnings(false);
}

void request_stop_of_work() {
  ends = true;
  if (nb::cast<int>(nb::module_::import_("threading").attr("active_count")()) > 1) expect_leaks();
}

/// Waits before static objects are destroyed. Threads that request the GIL from now on block.
void wait_for_threads() {
  has_ended = true;
  while (working > 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

template <class Take>
auto locked_by(const Take& take) {
  if (has_ended) stay();
  return giving_the_lock_away(take);
}

}  // namespace

bool interpreter_ends() {
  return ends;
}

void stay() {
  for (;;) ::pause();
}

Unlocked::Unlocked() {
  ++working;
  state_ = PyEval_SaveThread();
}

Unlocked::~Unlocked() {
  leave();
  locked_by([this] {
    PyEval_RestoreThread(state_);
    return true;
  });
}

void Unlocked::leave() {
  if (in_python_++ == 0) --working;
}

void Unlocked::enter() {
  if (--in_python_ == 0) ++working;
}

Locked::Locked(Unlocked& call) : call_(call) {
  call_.leave();
  state_ = locked_by(PyGILState_Ensure);
}

Locked::~Locked() {
  call_.enter();
  PyGILState_Release(state_);
}

void wait_for_threads_at_exit() {
  nb::module_::import_("atexit").attr("register")(nb::cpp_function(&request_stop_of_work));
  Py_AtExit(wait_for_threads);
  // A forked child has only the forking thread.
  const auto forked = nb::cpp_function([] {
    working = 0;
    expect_leaks();
  });
  nb::module_::import_("os").attr("register_at_fork")("after_in_child"_a = forked);
}

}  // namespace revisit::python
