#pragma once

#include <pthread.h>

#include <mutex>

namespace revisit::engine {

/// Guards state shared by all threads of the process. fork() acquires it, so that the child, which
/// has only the forking thread, finds it free. Must be held briefly.
inline std::mutex& process_lock() {
  static std::mutex lock;
  [[maybe_unused]] static const int kIsRegistered =
      ::pthread_atfork([] { process_lock().lock(); }, [] { process_lock().unlock(); },
                       [] { process_lock().unlock(); });
  return lock;
}

}  // namespace revisit::engine
