#pragma once

namespace revisit::engine {

/// Makes fork() end the threads that OpenMP keeps for the calling thread, which get others when
/// they are needed: the child, which has none of them, would wait for them for ever. Returns true.
bool end_threads_at_fork() noexcept;

/// Whoever makes parallel regions has this done when it is loaded.
inline const bool kThreadsEndAtFork = end_threads_at_fork();

}  // namespace revisit::engine
