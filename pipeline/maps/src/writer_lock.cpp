#include "writer_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "revisit/base/error.h"

namespace revisit {
namespace {

/// True if `file` is still the opened file: a writer that ends removes it.
bool is_there(int descriptor, const std::filesystem::path& file) {
  struct stat opened {
  }, named{};
  return ::fstat(descriptor, &opened) == 0 && ::stat(file.c_str(), &named) == 0 &&
         opened.st_ino == named.st_ino;
}

}  // namespace

WriterLock::WriterLock(const std::filesystem::path& map, const std::string& name)
    : file_(map.string() + "-writer") {
  while (true) {
    descriptor_ = ::open(file_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
    if (descriptor_ < 0)
      throw Error(name, ": cannot be written: ", file_.filename().string(), ": ",
                  std::strerror(errno));
    const bool locked = ::flock(descriptor_, LOCK_EX | LOCK_NB) == 0;
    if (locked && is_there(descriptor_, file_)) return;
    const int reason = errno;
    ::close(descriptor_);
    if (locked) continue;
    if (reason == EWOULDBLOCK)
      throw Error(name, ": another process is writing to this map; wait for it to end");
    throw Error(name, ": cannot be locked: ", std::strerror(reason));
  }
}

WriterLock::~WriterLock() {
  ::unlink(file_.c_str());
  ::close(descriptor_);
}

}  // namespace revisit
