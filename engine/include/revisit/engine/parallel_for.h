#pragma once

#include <atomic>
#include <cstdint>
#include <exception>
#include <mutex>

#include "revisit/engine/fork.h"
#include "revisit/engine/parallel_region.h"

namespace revisit {

/// Calls `work(item)` for every item in [0, items) on up to `threads` threads; when one throws, no
/// new items are begun, and the exception of the lowest item that threw comes out. Items must be
/// independent, and must not depend on the number of threads.
template <class Work>
void parallel_for(int64_t items, int threads, const Work& work) {
  std::exception_ptr error;
  int64_t failed_item = items;
  std::mutex mutex;
  std::atomic<bool> failed = false;
  {
    engine::RegionForSanitizer region;
#pragma omp parallel for num_threads(threads) schedule(dynamic, 1) if (threads > 1 && items > 1)
    for (int64_t item = 0; item < items; ++item) {
      region.enter();
      if (failed) continue;
      try {
        work(item);
      } catch (...) {
        const std::scoped_lock lock(mutex);
        if (item < failed_item) {
          failed_item = item;
          error = std::current_exception();
        }
        failed = true;
      }
      region.leave();
    }
  }
  if (error) std::rethrow_exception(error);
}

/// Calls `work(begin, end)` for consecutive ranges of at most `grain` items that cover [0, items).
template <class Work>
void parallel_ranges(int64_t items, int64_t grain, int threads, const Work& work) {
  parallel_for((items + grain - 1) / grain, threads, [&](int64_t range) {
    work(range * grain, range * grain + grain < items ? range * grain + grain : items);
  });
}

}  // namespace revisit
