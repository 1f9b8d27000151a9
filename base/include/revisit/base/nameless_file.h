#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace revisit {

/// A file without a name, for what need not be in memory: in TMPDIR, else in /var/tmp or /tmp. It
/// goes with this object or its process.
class NamelessFile {
 public:
  /// Throws Error when there can be none.
  NamelessFile();
  ~NamelessFile();
  NamelessFile(const NamelessFile&) = delete;
  NamelessFile& operator=(const NamelessFile&) = delete;

  /// Returns where the bytes begin. Throws Error when they cannot be written, and in a process
  /// that was forked, as both would write the same file: none is added then.
  int64_t append(std::span<const std::byte> bytes);
  /// Fills `bytes` from the byte `at` on; several threads may. Throws Error.
  void read(int64_t at, std::span<std::byte> bytes) const;

 private:
  int file_ = -1;
  int owner_;  // process
  int64_t size_ = 0;
};

}  // namespace revisit
