#include "process_lock.h"

#include <pthread.h>

namespace revisit::engine {
namespace {

std::mutex the_process_lock;

[[maybe_unused]] const bool kForkWaitsForLock =
    ::pthread_atfork([] { the_process_lock.lock(); }, [] { the_process_lock.unlock(); },
                     [] { the_process_lock.unlock(); }) == 0;

}  // namespace

std::mutex& process_lock() {
  return the_process_lock;
}

}  // namespace revisit::engine
