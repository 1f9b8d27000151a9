#pragma once

#include <omp.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>

#include "kernels/float_mode.h"
#include "kernels/split.h"
#include "revisit/engine/fork.h"
#include "revisit/engine/parallel_region.h"

namespace revisit::engine {

/// Sees what the thread that sets `here` would share with others: it then does all items itself,
/// one after the other, while their number is that for all threads.
class RegionObserver {
 public:
  virtual ~RegionObserver() = default;
  virtual void before_region() = 0;
  virtual void after_item() = 0;
  static inline thread_local RegionObserver* here = nullptr;
};

/// Calls `work(item, thread)` for every item in [0, items), on up to `threads` threads. Items must
/// be independent, and no value may depend on how many there are: their number may depend on the
/// number of threads. Every thread calculates in the FloatMode of the calling one.
///
/// A thread begins with a range of items of its own, which is the same part of all in every region:
/// what it wrote in one layer is in its cache for the next. Then it takes what others have left.
template <class Work>
void parallel_for(int64_t items, int threads, const Work& work) {
  RegionObserver* const observer = RegionObserver::here;
  if (threads <= 1 || items <= 1 || observer) {
    if (observer) observer->before_region();
    for (int64_t item = 0; item < items; ++item) {
      work(item, 0);
      if (observer) observer->after_item();
    }
    return;
  }
  const FloatMode mode = FloatMode::current();
  constexpr int kMaxRanges = 64;  // more threads share them
  const int64_t parts = std::min<int64_t>(items, std::min(threads, kMaxRanges));
  struct alignas(64) Range {  // a cache line each
    std::atomic<int64_t> next;
  };
  std::array<Range, kMaxRanges> own;
  for (int64_t i = 0; i < parts; ++i) own[i].next = Split{items, parts}.begin(i);
  RegionForSanitizer region;
#pragma omp parallel num_threads(threads)
  {
    region.enter();
    const FloatModeScope scope(mode);
    const int thread = omp_get_thread_num();
    for (int64_t i = 0; i < parts; ++i) {
      const int64_t range = (thread + i) % parts;
      const int64_t end = Split{items, parts}.end(range);
      std::atomic<int64_t>& next = own[range].next;
      for (int64_t item; (item = next.fetch_add(1, std::memory_order_relaxed)) < end;)
        work(item, thread);
    }
    region.leave();
  }
}

/// Enough elements of a simple loop to be worth a thread's while.
constexpr int64_t kParallelGrain = 16384;

/// Calls `work(begin, end)` for consecutive ranges of at most `grain` items that cover [0, items),
/// on up to `threads` threads. The ranges do not depend on the number of threads.
template <class Work>
void parallel_ranges(int64_t items, int64_t grain, int threads, const Work& work) {
  parallel_for((items + grain - 1) / grain, threads, [&](int64_t range, int) {
    work(range * grain, std::min((range + 1) * grain, items));
  });
}

}  // namespace revisit::engine
