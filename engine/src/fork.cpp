#include "revisit/engine/fork.h"

#include <omp.h>
#include <pthread.h>

namespace revisit::engine {

bool end_threads_at_fork() noexcept {
  return ::pthread_atfork([] { omp_pause_resource_all(omp_pause_soft); }, nullptr, nullptr) == 0;
}

}  // namespace revisit::engine
