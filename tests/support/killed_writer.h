#pragma once

#include <cstdint>
#include <functional>

namespace revisit::test {

/// Runs `write` in a process of its own and kills that: after so many answers and then some
/// microseconds, or when it ends by itself, which is a failure. `write` has the end of a pipe for
/// the numbers that were acknowledged, an int64_t each. Returns the last of them, or `before`.
int64_t last_before_kill(const std::function<void(int pipe)>& write, int answers, int microseconds,
                         int64_t before);

}  // namespace revisit::test
