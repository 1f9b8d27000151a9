#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>

namespace revisit {

/// Called with the units done so far and their total.
using Progress = std::function<void(int64_t done, int64_t total)>;

/// Callbacks of long work. Defaults ignore everything.
struct Observer {
  std::function<void(const std::string&)> note = [](const std::string&) {};  ///< choices made
  std::function<void(const std::string&)> warn = [](const std::string&) {};  ///< problems
  /// Begins a stage, e.g. ("describing", "scans"). It ends when the returned function is destroyed.
  std::function<Progress(const char* verb, const char* unit)> stage = [](const char*, const char*) {
    return [](int64_t, int64_t) {};
  };
  std::function<bool()> stop = [] { return false; };  ///< true: the work throws Interrupted
};

/// Returns a function that measures milliseconds since its last call, at first since this one.
inline auto stopwatch() {
  using Clock = std::chrono::steady_clock;
  return [last = Clock::now()]() mutable {
    const Clock::time_point now = Clock::now();
    return std::chrono::duration<double, std::milli>(now - std::exchange(last, now)).count();
  };
}

}  // namespace revisit
