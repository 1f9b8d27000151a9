#pragma once

#include <nanobind/nanobind.h>

#include <atomic>
#include <string>

#include "arrays.h"
#include "revisit/engine/net.h"

namespace revisit::python {

/// Detects concurrent use, because without the GIL two threads would write to the same memory.
class Run {
 public:
  explicit Run(const engine::Plan& plan);

  const engine::Plan& plan() const { return run_.plan(); }
  /// Memory with a stable address. Callers must not write to it during a pass.
  engine::View<float> input(const std::string& name) { return run_.input(name); }

  /// Calls `work(run)`. Throws UsageError if another thread is in such a call.
  template <class Work>
  auto alone(const Work& work) {
    if (working_.exchange(true))
      throw UsageError(
          "Run: another thread is using it; create one per thread with Plan.run() (weights are "
          "shared)");
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
