#pragma once

#include <mutex>

namespace revisit::engine {

/// Guards what all threads of the process share. fork() waits for it: the child, which has none of
/// the other threads, finds it free. To be held for a moment only.
std::mutex& process_lock();

}  // namespace revisit::engine
