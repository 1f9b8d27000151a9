#pragma once

#include <mutex>

namespace revisit::engine {

/// Guards state shared by all threads of the process. fork() acquires it, so that the child, which
/// has only the forking thread, finds it free. Must be held briefly.
std::mutex& process_lock();

}  // namespace revisit::engine
