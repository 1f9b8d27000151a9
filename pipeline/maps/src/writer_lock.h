#pragma once

#include <filesystem>
#include <string>

namespace revisit::pipeline {

/// Makes this object the only writer of a map, by a lock on FILE-writer, which goes with the
/// process, also by a kill. (SQLite's own lock lasts one transaction only, and a lock on the map
/// itself would drop SQLite's when it is closed.)
class WriterLock {
 public:
  /// `name`: the map as the user knows it. Throws Error when there is a writer, or no permission.
  WriterLock(const std::filesystem::path& map, const std::string& name);
  ~WriterLock();
  WriterLock(const WriterLock&) = delete;
  WriterLock& operator=(const WriterLock&) = delete;

 private:
  std::filesystem::path file_;
  int descriptor_ = -1;
};

}  // namespace revisit::pipeline
