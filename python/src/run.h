#pragma once

#include <nanobind/nanobind.h>

#include <atomic>
#include <string>

#include "arrays.h"
#include "revisit/engine/net.h"

namespace revisit::python {

/// A run that says so when two threads use it at the same time: without the interpreter's lock
/// both would write to the same memory.
class Run {
 public:
  explicit Run(const engine::Plan& plan);

  const engine::Plan& plan() const { return run_.plan(); }
  /// The memory, which stays where it is; who writes to it during a pass is to blame.
  engine::View<float> input(const std::string& name) { return run_.input(name); }

  /// Calls `work(run)`; UsageError while another thread is in here.
  template <class Work>
  auto alone(const Work& work) {
    if (working_.exchange(true))
      throw UsageError(
          "another thread is using this run; make one for each thread (Plan.run()), which is "
          "cheap: the weights are shared");
    struct Done {
      std::atomic<bool>& working;
      ~Done() { working = false; }
    } done{working_};
    return work(run_);
  }

 private:
  engine::Run run_;
  std::atomic<bool> working_ = false;
};

void bind_run(nanobind::module_& module);

}  // namespace revisit::python
