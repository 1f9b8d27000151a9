#pragma once

#include <cstdint>
#include <functional>

namespace revisit::test {

/// Runs `write` in a child process and kills it `microseconds` after `answers` answers. It fails if
/// the child ends by itself. `write` sends each acknowledged number, an int64_t, through the pipe.
/// Returns the last of them, or `before`.
int64_t last_before_kill(const std::function<void(int pipe)>& write, int answers, int microseconds,
                         int64_t before);

}  // namespace revisit::test
