#include "revisit/proto/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>

namespace revisit {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const fs::path& file, const fs::path& temporary, const char* doing) {
  const int reason = errno;
  std::error_code ignored;
  fs::remove(temporary, ignored);
  throw Error(
      str(file.string(), ": cannot ", doing, ": ", reason ? std::strerror(reason) : "write error"));
}

/// Forces the data to the disk, so that a rename never precedes what it names.
bool sync_to_disk(const fs::path& file) {
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return false;
  const bool synced = ::fsync(descriptor) == 0 || errno == EINVAL;  // EINVAL: no such notion there
  ::close(descriptor);
  return synced;
}

}  // namespace

void write_atomically(const fs::path& file, const std::function<void(std::ostream&)>& write) {
  const fs::path temporary = file.string() + "." + std::to_string(::getpid()) + ".part";
  errno = 0;
  std::ofstream out(temporary, std::ios::binary | std::ios::trunc);
  if (!out) fail(file, temporary, "create");
  try {
    write(out);
  } catch (...) {
    out.close();
    std::error_code ignored;
    fs::remove(temporary, ignored);
    throw;
  }
  if (!out.flush()) fail(file, temporary, "write");
  out.close();
  if (!out || !sync_to_disk(temporary)) fail(file, temporary, "write");
  if (::rename(temporary.c_str(), file.c_str()) != 0) fail(file, temporary, "rename into place");
}

}  // namespace revisit
