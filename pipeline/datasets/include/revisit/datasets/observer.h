#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace revisit {

using Progress = std::function<void(int64_t done, int64_t total)>;

struct Observer {
  std::function<void(const std::string&)> note = [](const std::string&) {};
  std::function<void(const std::string&)> warn = [](const std::string&) {};
  /// Begins a stage, e.g. ("describing", "scans"). It ends when the returned function is destroyed.
  std::function<Progress(const char* verb, const char* unit)> stage = [](const char*, const char*) {
    return [](int64_t, int64_t) {};
  };
  std::function<bool()> stop = [] { return false; };  // true: the work throws Interrupted
};

}  // namespace revisit
