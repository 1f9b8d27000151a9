#pragma once

#include <unistd.h>

#include <cerrno>
#include <cstdint>

namespace revisit {

/// Reads `size` bytes at `offset`, or fewer at the end of the file; -1 on error.
inline int64_t read_at(int descriptor, void* out, int64_t size, int64_t offset) {
  int64_t done = 0;
  while (done < size) {
    const ssize_t got =
        ::pread(descriptor, static_cast<char*>(out) + done, size - done, offset + done);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return -1;
    if (got == 0) break;
    done += got;
  }
  return done;
}

/// Writes `size` bytes at `offset`. Returns false on error; errno is set.
inline bool write_at(int descriptor, const void* data, int64_t size, int64_t offset) {
  int64_t done = 0;
  while (done < size) {
    const ssize_t written =
        ::pwrite(descriptor, static_cast<const char*>(data) + done, size - done, offset + done);
    if (written < 0 && errno != EINTR) return false;
    if (written > 0) done += written;
  }
  return true;
}

}  // namespace revisit
