#pragma once

#include <mutex>
#include <string>
#include <vector>

namespace revisit::python {

/// What libraries have to say to a person, from any thread: kept until somebody asks. They are not
/// told to functions of Python's, which would want its lock while the libraries hold theirs.
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
