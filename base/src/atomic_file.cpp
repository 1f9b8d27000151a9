#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <ext/stdio_filebuf.h>

#include "revisit/base/files.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;
using FileBuffer = __gnu_cxx::stdio_filebuf<char>;

constexpr int kMaxLinks = 40;  // the kernel's own limit

[[noreturn]] void fail(const fs::path& file, const char* doing) {
  throw Error(file.string(), ": cannot ", doing, ": ",
              errno ? std::strerror(errno) : "write error");
}

const char* kind_of(fs::file_type type) {
  if (type == fs::file_type::directory) return "folder";
  if (type == fs::file_type::block) return "block device";
  if (type == fs::file_type::socket) return "socket";
  if (type == fs::file_type::fifo) return "FIFO";
  if (type == fs::file_type::character) return "character device";
  return "special file";
}

bool is_same_file(const struct stat& a, const struct stat& b) {
  return a.st_ino == b.st_ino && a.st_dev == b.st_dev;
}

/// True for /dev/stdout by any name, and for the file that it is redirected to.
bool is_stdout(const fs::path& file) {
  struct stat output {
  }, named{};
  return ::fstat(STDOUT_FILENO, &output) == 0 && ::stat(file.c_str(), &named) == 0 &&
         is_same_file(output, named);
}

bool is_replaced(const fs::path& file) {
  if (!file.has_filename())
    throw UsageError(file.string(), ": names a folder, expected a file to write");
  if (is_stdout(file)) return false;
  std::error_code ignored;  // open() fails later on the same file and reports the reason
  const fs::file_type type = fs::status(file, ignored).type();
  switch (type) {
    case fs::file_type::fifo:
    case fs::file_type::character:
      return false;
    case fs::file_type::none:
    case fs::file_type::not_found:
    case fs::file_type::regular:
      return true;
    default:
      throw UsageError(file.string(), ": is a ", kind_of(type), ", expected a file to write");
  }
}

/// The file that a chain of symbolic links names; it need not exist.
fs::path without_links(const fs::path& file) {
  fs::path target = file;
  for (int links = 0; fs::is_symlink(target); ++links) {
    if (links == kMaxLinks) throw UsageError(file.string(), ": too many symbolic links");
    target = target.parent_path() / fs::read_symlink(target);
  }
  return target;
}

void fill(FileBuffer& buffer, const fs::path& file,
          const std::function<void(std::ostream&)>& write) {
  std::ostream out(&buffer);
  errno = 0;
  write(out);
  if (!out.flush()) fail(file, "write");
  // FIFOs and devices do not support fsync (EINVAL, EROFS).
  if (::fsync(buffer.fd()) != 0 && errno != EINVAL && errno != EROFS) fail(file, "write");
}

/// A new file beside `target`, removed unless it is renamed.
class Temporary {
 public:
  explicit Temporary(const fs::path& target) : target_(target) {
    static std::atomic<int> calls;
    int descriptor = -1;
    do {
      path_ = target.string() + str(".", ::getpid(), "-", ++calls, ".part");
      descriptor = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    } while (descriptor < 0 && errno == EEXIST);
    if (descriptor < 0) fail(target, "create");
    struct stat replaced {};
    if (::stat(target.c_str(), &replaced) == 0)
      static_cast<void>(::fchmod(descriptor, replaced.st_mode & 0777));
    buffer_ = FileBuffer(descriptor, std::ios::out | std::ios::binary);
  }
  ~Temporary() { ::unlink(path_.c_str()); }
  Temporary(const Temporary&) = delete;
  Temporary& operator=(const Temporary&) = delete;

  FileBuffer& buffer() { return buffer_; }
  void replace_target() { rename_into_place(path_, target_); }

 private:
  fs::path target_, path_;
  FileBuffer buffer_;
};

}  // namespace

bool check_target(const fs::path& file) {
  if (!is_replaced(file)) return false;
  const fs::path folder = fs::absolute(without_links(file)).parent_path();
  std::error_code ignored;  // of a folder that cannot be entered: reported when the file is written
  const fs::file_type type = fs::status(folder, ignored).type();
  if (type != fs::file_type::directory && type != fs::file_type::none)
    throw Error(file.string(), ": cannot create: there is no folder ", folder.string());
  return true;
}

void write_atomically(const fs::path& file, const std::function<void(std::ostream&)>& write) {
  if (is_replaced(file)) {
    Temporary temporary(without_links(file));
    fill(temporary.buffer(), file, write);
    temporary.replace_target();
    return;
  }
  const int descriptor = is_stdout(file) ? ::fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 0)
                                         : ::open(file.c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC);
  if (descriptor < 0) fail(file, "open");
  FileBuffer buffer(descriptor, std::ios::out | std::ios::binary);
  fill(buffer, file, write);
}

void rename_into_place(const fs::path& temporary, const fs::path& file) {
  struct stat there {};
  if (::lstat(file.c_str(), &there) == 0 && !S_ISREG(there.st_mode) && !S_ISLNK(there.st_mode))
    throw Error(file.string(), ": is a ", kind_of(fs::symlink_status(file).type()),
                ", which a file cannot replace");
  if (::rename(temporary.c_str(), file.c_str()) != 0) fail(file, "rename into place");
}

bool is_named(int descriptor, const fs::path& file) {
  struct stat opened {
  }, named{};
  return ::fstat(descriptor, &opened) == 0 && ::lstat(file.c_str(), &named) == 0 &&
         is_same_file(opened, named);
}

void lock_part(int descriptor, const fs::path& part) {
  if (::flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
    throw Error(part.string(),
                ": another process is writing this file; wait for it or write to another folder");
  // If the previous holder of the lock has finished, this descriptor is on the renamed file.
  if (!is_named(descriptor, part))
    throw Error(part.string(), ": another process has just finished this file; run again");
}

void make_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw Error(folder.string(), ": cannot create the folder: ", error.message());
}

}  // namespace revisit
