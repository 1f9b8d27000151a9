#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace revisit::pipeline {

using Progress = std::function<void(int64_t done, int64_t total)>;

/// What work that takes minutes or hours reports to its caller. By default it is ignored.
struct Observer {
  std::function<void(const std::string&)> note = [](const std::string&) {};  // good to know
  std::function<void(const std::string&)> warn = [](const std::string&) {};  // may be a mistake
  /// Begins a stage, e.g. ("describing", "scans"). It ends when what was returned is destroyed.
  std::function<Progress(const char* verb, const char* unit)> stage = [](const char*, const char*) {
    return [](int64_t, int64_t) {};
  };
  std::function<bool()> stop = [] { return false; };  // true: the work throws Interrupted
};

}  // namespace revisit::pipeline
