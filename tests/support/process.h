#pragma once

#include <sys/types.h>

#include <functional>

namespace revisit::test {

/// A forked process that ends when `work` returns, or is killed with this object.
class Process {
 public:
  explicit Process(const std::function<void()>& work);
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  /// Sends SIGKILL and waits. Fails the test if the process has ended by itself.
  void kill();
  /// Waits. True if `work` returned without an exception and without a failed expectation.
  bool succeeds();

 private:
  int wait();
  pid_t id_ = -1;
};

}  // namespace revisit::test
