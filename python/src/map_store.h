#pragma once

#include <nanobind/nanobind.h>

#include <memory>
#include <mutex>

#include "revisit/base/error.h"
#include "revisit/maps/map_store.h"

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

/// A thread-safe MapStore. Callers must not hold the GIL, because they may wait for the mutex.
class OpenMap {
 public:
  explicit OpenMap(std::unique_ptr<MapStore> store) : store_(std::move(store)) {}
  Messages messages;  // about corrupt entries

  void close() {
    const std::lock_guard lock(mutex_);
    store_.reset();
  }
  /// Throws UsageError if the map was closed.
  template <class Work>
  auto with(const Work& work) {
    const std::lock_guard lock(mutex_);
    if (!store_) throw UsageError("MapStore: the map was closed; open it again");
    return work(*store_);
  }

 private:
  std::mutex mutex_;
  std::unique_ptr<MapStore> store_;
};

void bind_map_store(nanobind::module_& module);

}  // namespace revisit::python
