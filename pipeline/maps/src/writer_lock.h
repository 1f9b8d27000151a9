#pragma once

#include <filesystem>
#include <string>

namespace revisit::pipeline {

/// Makes this object the only writer of a map, by a lock on FILE-writer, which the system releases
/// when the process ends. (SQLite's own lock lasts for one transaction only. A lock on the map
/// itself would release SQLite's locks when it is closed.)
class WriterLock {
 public:
  /// `name`: the map's name in messages. Throws Error if there is another writer, or no permission.
  WriterLock(const std::filesystem::path& map, const std::string& name);
  ~WriterLock();
  WriterLock(const WriterLock&) = delete;
  WriterLock& operator=(const WriterLock&) = delete;

 private:
  std::filesystem::path file_;
  int descriptor_ = -1;
};

}  // namespace revisit::pipeline
