#include "revisit/base/part_lock.h"

#include <sys/file.h>
#include <sys/stat.h>

#include <cerrno>

#include "revisit/base/error.h"

namespace revisit {

void lock_part(int descriptor, const std::filesystem::path& part) {
  if (::flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
    throw Error(part.string(),
                ": another process is writing this file; wait for it or write to another folder");
  // If the previous holder of the lock has finished, this descriptor is on the renamed file.
  struct stat opened {
  }, named{};
  if (::fstat(descriptor, &opened) != 0 || ::stat(part.c_str(), &named) != 0 ||
      opened.st_ino != named.st_ino)
    throw Error(part.string(), ": another process has just finished this file; run again");
}

}  // namespace revisit
