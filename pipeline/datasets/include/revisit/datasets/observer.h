#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace revisit::pipeline {

using Progress = std::function<void(int64_t done, int64_t total)>;

/// Callbacks of long-running work. The defaults do nothing.
struct Observer {
  std::function<void(const std::string&)> note = [](const std::string&) {};  // information
  std::function<void(const std::string&)> warn = [](const std::string&) {};  // possible mistake
  /// Begins a stage, e.g. ("describing", "scans"). It ends when the returned function is destroyed.
  std::function<Progress(const char* verb, const char* unit)> stage = [](const char*, const char*) {
    return [](int64_t, int64_t) {};
  };
  std::function<bool()> stop = [] { return false; };  // true: the work throws Interrupted
};

}  // namespace revisit::pipeline
