#pragma once

#include <filesystem>
#include <string>

namespace revisit {

/// Lock of the only writer of a map, on FILE-writer; ends with the process. SQLite's own lock lasts
/// for one transaction; a lock on the map itself would release SQLite's locks when closed.
class WriterLock {
 public:
  /// Throws Error if there is another writer, or no permission.
  WriterLock(const std::filesystem::path& map, const std::string& name);
  ~WriterLock();
  WriterLock(const WriterLock&) = delete;
  WriterLock& operator=(const WriterLock&) = delete;

 private:
  std::filesystem::path file_;
  int descriptor_ = -1;
};

}  // namespace revisit
