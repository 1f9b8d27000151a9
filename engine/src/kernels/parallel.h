#pragma once

#include <omp.h>

#include <algorithm>
#include <cstdint>

namespace revisit::engine {

/// Calls `work(item, thread)` for every item in [0, items), on up to `threads` threads. Items must
/// be independent; their size must not depend on the number of threads.
template <class Work>
void parallel_for(int64_t items, int threads, const Work& work) {
  if (threads <= 1 || items <= 1) {
    for (int64_t item = 0; item < items; ++item) work(item, 0);
    return;
  }
#pragma omp parallel for num_threads(threads) schedule(dynamic, 1)
  for (int64_t item = 0; item < items; ++item) work(item, omp_get_thread_num());
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
