#include "simulation/each.h"

#include <omp.h>

#include <algorithm>
#include <atomic>
#include <exception>

namespace revisit::pipeline::simulation {

int threads_for(int asked, int64_t items) {
  const int64_t most = asked > 0 ? asked : omp_get_max_threads();
  return static_cast<int>(std::clamp<int64_t>(items, 1, most));
}

void for_each_item(int64_t items, int threads,
                   const std::function<void(int64_t item, int thread)>& make,
                   const std::function<bool(int64_t item)>& done) {
  std::atomic<bool> ended{false};
  std::exception_ptr failure;
#pragma omp parallel for schedule(dynamic) num_threads(threads)
  for (int64_t item = 0; item < items; ++item) {
    if (ended) continue;
    try {
      make(item, omp_get_thread_num());
    } catch (...) {
#pragma omp critical(revisit_simulation)
      if (!failure) failure = std::current_exception();
      ended = true;
      continue;
    }
#pragma omp critical(revisit_simulation)
    {
      try {
        if (!done(item)) ended = true;
      } catch (...) {
        if (!failure) failure = std::current_exception();
        ended = true;
      }
    }
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace revisit::pipeline::simulation
