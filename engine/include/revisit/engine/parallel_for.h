#pragma once

#include <algorithm>
#include <cstdint>
#include <type_traits>

namespace revisit {
namespace engine {

/// parallel_for() of `work(object, item, thread)`.
void share_items(int64_t items, int threads,
                 void (*work)(const void* object, int64_t item, int thread), const void* object);

}  // namespace engine

/// Calls `work(item)`, or `work(item, thread)` where it takes that, for every item in [0, items) on
/// up to `threads` threads. They calculate in the float mode of the calling one. Items must be
/// independent. Where their number depends on that of the threads, no value may depend on it.
///
/// A thread begins with a range of items of its own, which is the same part of all in every region:
/// what it wrote in one is in its cache for the next. Then it takes what others have left.
///
/// Rethrows the exception of the lowest item that throws; some items beyond it may have been done.
template <class Work>
void parallel_for(int64_t items, int threads, const Work& work) {
  const auto call = [](const void* object, int64_t item, int thread) {
    if constexpr (std::is_invocable_v<const Work&, int64_t, int>)
      (*static_cast<const Work*>(object))(item, thread);
    else
      (*static_cast<const Work*>(object))(item);
  };
  if (threads > 1)
    engine::share_items(items, threads, call, &work);
  else
    for (int64_t item = 0; item < items; ++item) call(&work, item, 0);
}

/// Enough elements of a simple loop to be worth a thread's while.
constexpr int64_t kParallelGrain = 16384;

/// Calls `work(begin, end)` for consecutive ranges of at most `grain` items that cover [0, items).
/// The ranges do not depend on the number of threads.
template <class Work>
void parallel_ranges(int64_t items, int64_t grain, int threads, const Work& work) {
  parallel_for((items + grain - 1) / grain, threads,
               [&](int64_t range) { work(range * grain, std::min((range + 1) * grain, items)); });
}

}  // namespace revisit
