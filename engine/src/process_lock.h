#pragma once

#include <pthread.h>

#include <mutex>

namespace revisit::engine {

/// Guards state shared by all threads of the process. fork() acquires it, so that the child, which
/// has only the forking thread, finds it free. Must be held briefly.
inline std::mutex& process_lock() {
  static std::mutex lock;
  return lock;
}

/// Set before main(): a child that is forked meanwhile would wait for the thread that sets them.
[[maybe_unused]] inline const int kForkHandlers =
    ::pthread_atfork([] { process_lock().lock(); }, [] { process_lock().unlock(); },
                     [] { process_lock().unlock(); });

}  // namespace revisit::engine
