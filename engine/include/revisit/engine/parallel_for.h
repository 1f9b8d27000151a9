#pragma once

#include <algorithm>
#include <cstdint>
#include <type_traits>

namespace revisit {
namespace engine {

/// Implementation of parallel_for() for `work(object, item, thread)`.
void share_items(int64_t items, int threads,
                 void (*work)(const void* object, int64_t item, int thread), const void* object);

}  // namespace engine

/// Calls `work(item)`, or `work(item, thread)` if it accepts that, for all items in [0, items) on
/// up to `threads` threads, in the float mode of the calling thread. Items must be independent. If
/// their number depends on the number of threads, no result may depend on it.
///
/// Each thread starts with its own range of items, the same fraction in every call, so that data it
/// wrote before is in its cache. Then it steals remaining items of other threads.
///
/// Rethrows the exception of the lowest throwing item; later items may have been executed.
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

/// Minimum number of elements of a simple loop for which a thread pays off.
constexpr int64_t kParallelGrain = 16384;

/// Calls `work(begin, end)` for consecutive ranges of at most `grain` items that cover [0, items).
/// The ranges do not depend on the number of threads.
template <class Work>
void parallel_ranges(int64_t items, int64_t grain, int threads, const Work& work) {
  parallel_for((items + grain - 1) / grain, threads,
               [&](int64_t range) { work(range * grain, std::min((range + 1) * grain, items)); });
}

}  // namespace revisit
