#pragma once

#include <nanobind/nanobind.h>

#include <memory>
#include <mutex>

#include "messages.h"
#include "revisit/base/error.h"
#include "revisit/maps/map_store.h"

namespace revisit::python {

/// A map for any number of threads, one after the other, until a recogniser takes it. To be called
/// without the interpreter's lock: whoever waits must not hold it.
class OpenMap {
 public:
  explicit OpenMap(std::unique_ptr<pipeline::MapStore> store) : store_(std::move(store)) {}
  Messages messages;  // of damaged places

  /// Calls `take(store)`, which may move from it. UsageError when it was taken or closed before.
  template <class Take>
  void give(const Take& take) {
    const std::lock_guard lock(mutex_);
    check();
    take(std::move(store_));
  }
  void close() {
    const std::lock_guard lock(mutex_);
    store_.reset();
  }
  /// Calls `work(store)`.
  template <class Work>
  auto with(const Work& work) {
    const std::lock_guard lock(mutex_);
    check();
    return work(*store_);
  }

 private:
  void check() const {
    if (!store_)
      throw UsageError(
          "the map was closed, or belongs to a PlaceRecognizer; open it again to look at it");
  }
  std::mutex mutex_;
  std::unique_ptr<pipeline::MapStore> store_;
};

void bind_map_store(nanobind::module_& module);

}  // namespace revisit::python
