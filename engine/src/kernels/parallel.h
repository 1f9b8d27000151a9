#pragma once

#include <omp.h>

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

}  // namespace revisit::engine
