#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <string>

#include "revisit/base/files.h"

namespace revisit {
namespace {

[[noreturn]] void fail_nameless(const char* what) {
  throw Error("temporary file (in TMPDIR or /var/tmp): ", what);
}

int open_nameless() {
  const char* const chosen = std::getenv("TMPDIR");
  // /tmp may be in memory (tmpfs), like the last resort memfd_create().
  for (const char* folder :
       {chosen != nullptr && *chosen != '\0' ? chosen : "/var/tmp", "/var/tmp", "/tmp"}) {
    std::string name = str(folder, "/revisit-XXXXXX");
    const int file = ::mkostemp(name.data(), O_CLOEXEC);
    if (file < 0) continue;
    ::unlink(name.c_str());
    return file;
  }
  const int file = ::memfd_create("revisit", MFD_CLOEXEC);
  if (file < 0) fail_nameless(std::strerror(errno));
  return file;
}

template <class Step>
void move_all(size_t size, const Step& step) {
  for (size_t done = 0; done < size;) {
    const ssize_t n = step(done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) fail_nameless(n < 0 ? std::strerror(errno) : "unexpected end of file");
    done += static_cast<size_t>(n);
  }
}

}  // namespace

UnnamedFile::UnnamedFile() : file_(open_nameless()), owner_(::getpid()) {}

UnnamedFile::~UnnamedFile() {
  ::close(file_);
}

int64_t UnnamedFile::append(std::span<const std::byte> bytes) {
  if (::getpid() != owner_) fail_nameless("cannot append in a forked process");
  move_all(bytes.size(), [&](size_t done) {
    return ::pwrite(file_, bytes.data() + done, bytes.size() - done,
                    size_ + static_cast<int64_t>(done));
  });
  const int64_t begin = size_;
  size_ += std::ssize(bytes);
  return begin;
}

void UnnamedFile::read(int64_t at, std::span<std::byte> bytes) const {
  move_all(bytes.size(), [&](size_t done) {
    return ::pread(file_, bytes.data() + done, bytes.size() - done,
                   at + static_cast<int64_t>(done));
  });
}

}  // namespace revisit
