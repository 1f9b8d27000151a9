#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace revisit {

/// An unnamed temporary file for data that need not stay in memory, in TMPDIR, else /var/tmp or
/// /tmp. It is deleted with this object or at process exit.
class UnnamedFile {
 public:
  /// Throws Error if the file cannot be created.
  UnnamedFile();
  ~UnnamedFile();
  UnnamedFile(const UnnamedFile&) = delete;
  UnnamedFile& operator=(const UnnamedFile&) = delete;

  /// Returns the offset of the appended bytes. Throws Error if the write fails, or in a forked
  /// process, because parent and child would write to the same file; nothing is appended then.
  int64_t append(std::span<const std::byte> bytes);
  /// Fills `bytes` from offset `at`. Thread-safe. Throws Error.
  void read(int64_t at, std::span<std::byte> bytes) const;

 private:
  int file_ = -1;
  int owner_;  // process
  int64_t size_ = 0;
};

}  // namespace revisit
