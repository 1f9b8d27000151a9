#pragma once

#include <string>

#include "revisit/base/error.h"
#include "revisit/maps/map_store.h"

namespace revisit::pipeline {

/// Names neighbouring places that have the same damage with one message.
class DamagedPlaces {
 public:
  DamagedPlaces(const std::string& file, const MapStore::Damaged& tell)
      : file_(file), tell_(tell) {}

  /// `first` to `last`, which come after all that were added before.
  void add(int64_t first, int64_t last, const std::string& reason) {
    if (first_ != 0 && (first != last_ + 1 || reason != reason_)) flush();
    if (first_ == 0) first_ = first;
    last_ = last;
    reason_ = reason;
  }
  void flush() {
    if (first_ == 0) return;
    tell_(first_ == last_
              ? str(file_, ": place ", first_, " is damaged: ", reason_)
              : str(file_, ": places ", first_, " to ", last_, " are damaged: ", reason_));
    first_ = 0;
  }

 private:
  const std::string& file_;
  const MapStore::Damaged& tell_;
  int64_t first_ = 0, last_ = 0;
  std::string reason_;
};

}  // namespace revisit::pipeline
