#include "each.h"

#include <omp.h>

#include <algorithm>
#include <atomic>
#include <mutex>

#include "revisit/engine/parallel_for.h"

namespace revisit::pipeline::simulation {

int threads_for(int asked, int64_t items) {
  const int64_t most = asked > 0 ? asked : omp_get_max_threads();
  return static_cast<int>(std::clamp<int64_t>(items, 1, most));
}

void for_each_item(int64_t items, int threads,
                   const std::function<void(int64_t item, int thread)>& make,
                   const std::function<bool(int64_t item)>& done) {
  std::mutex mutex;
  std::atomic<bool> ended = false;
  parallel_for(items, threads, [&](int64_t item, int thread) {
    if (ended) return;
    make(item, thread);
    const std::scoped_lock lock(mutex);
    if (!done(item)) ended = true;
  });
}

}  // namespace revisit::pipeline::simulation
