#pragma once

#include <mutex>
#include <string>
#include <vector>

namespace revisit::python {

/// Thread-safe store of the libraries' warnings. Python callbacks would deadlock, because they need
/// the GIL while a library holds its mutexes.
class Messages {
 public:
  void add(const std::string& message) {
    const std::lock_guard lock(mutex_);
    messages_.push_back(message);
  }
  std::vector<std::string> all() const {
    const std::lock_guard lock(mutex_);
    return messages_;
  }

 private:
  mutable std::mutex mutex_;
  std::vector<std::string> messages_;
};

}  // namespace revisit::python
