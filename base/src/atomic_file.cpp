#include "revisit/base/files.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstring>
#include <ext/stdio_filebuf.h>
#include <optional>

namespace revisit {
namespace {

namespace fs = std::filesystem;
using FileBuffer = __gnu_cxx::stdio_filebuf<char>;

constexpr int kMaxLinks = 40;  // the kernel's own limit
constexpr int kMaxWritersPerTarget = 1000;

[[noreturn]] void fail(const fs::path& file, const char* doing) {
  throw Error(file.string(), ": cannot ", doing, ": ",
              errno ? std::strerror(errno) : "write error");
}

struct Target {
  fs::path file;
  Writing writing = Writing::kReplaces;
  std::optional<int> own_descriptor = {};
};

/// The descriptor that a path such as /proc/self/fd/1 names.
std::optional<int> own_descriptor(const fs::path& file) {
  std::error_code error, same;
  const fs::path folder =
      fs::canonical(file.parent_path().empty() ? "." : file.parent_path(), error);
  if (error || folder != fs::canonical("/proc/self/fd", same) || same) return {};
  const std::string name = file.filename().string();
  int descriptor = -1;
  const auto [end, problem] = std::from_chars(name.data(), name.data() + name.size(), descriptor);
  if (problem != std::errc() || end != name.data() + name.size()) return {};
  return descriptor;
}

const char* kind_of(fs::file_type type) {
  if (type == fs::file_type::directory) return "folder";
  if (type == fs::file_type::block) return "block device";
  if (type == fs::file_type::socket) return "socket";
  if (type == fs::file_type::fifo) return "FIFO";
  if (type == fs::file_type::character) return "character device";
  return "special file";
}

Target resolve(const fs::path& file) {
  Target target{file};
  for (int links = 0; links < kMaxLinks; ++links) {
    if (!target.file.has_filename())
      throw UsageError(file.string(), ": names a folder, expected a file to write");
    target.own_descriptor = own_descriptor(target.file);
    if (target.own_descriptor) {
      target.writing = Writing::kStreams;
      return target;
    }
    std::error_code ignored;  // open() fails later on the same file and reports the reason
    const fs::file_type type = fs::symlink_status(target.file, ignored).type();
    switch (type) {
      case fs::file_type::symlink:
        target.file = target.file.parent_path() / fs::read_symlink(target.file, ignored);
        continue;
      case fs::file_type::fifo:
      case fs::file_type::character:
        target.writing = Writing::kStreams;
        return target;
      case fs::file_type::none:
      case fs::file_type::not_found:
      case fs::file_type::regular:
        return target;
      default:
        throw UsageError(file.string(), ": is a ", kind_of(type), ", expected a file to write");
    }
  }
  throw UsageError(file.string(), ": too many symbolic links");
}

bool is_named(int descriptor, const fs::path& file) {
  struct stat opened {
  }, named{};
  return ::fstat(descriptor, &opened) == 0 && ::lstat(file.c_str(), &named) == 0 &&
         opened.st_ino == named.st_ino && opened.st_dev == named.st_dev;
}

/// Temporary file of one writer, locked while open. An unlocked one is left from a dead writer.
class Temporary {
 public:
  Temporary(const fs::path& file, const fs::path& target) {
    for (int i = 1; i < kMaxWritersPerTarget; ++i) {
      path_ = target.string() + str(".", i, ".part");
      remove_leftover(path_);
      const int descriptor =
          ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
      if (descriptor < 0 && errno == EEXIST) continue;
      if (descriptor < 0) break;
      buffer_.emplace(descriptor, std::ios::out | std::ios::binary);
      if (is_ours(descriptor)) {
        while (remove_leftover(target.string() + str(".", ++i, ".part"))) {
        }
        return;
      }
    }
    fail(file, "create");
  }
  /// Unlinks before unlocking; otherwise another writer would see an unlocked leftover.
  ~Temporary() {
    if (!path_.empty()) ::unlink(path_.c_str());
  }
  Temporary(const Temporary&) = delete;
  Temporary& operator=(const Temporary&) = delete;

  FileBuffer& buffer() { return *buffer_; }
  void rename_to(const fs::path& target) {
    rename_into_place(path_, target);
    path_.clear();
  }

 private:
  /// Locks the file. Fails if another writer has already removed it as a leftover.
  bool is_ours(int descriptor) const {
    if (::flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) return false;
    return is_named(descriptor, path_);
  }

  static bool remove_leftover(const fs::path& path) {
    const int descriptor = ::open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (descriptor < 0) return false;
    struct stat status {};
    const bool left = ::fstat(descriptor, &status) == 0 && S_ISREG(status.st_mode) &&
                      ::flock(descriptor, LOCK_EX | LOCK_NB) == 0 && is_named(descriptor, path) &&
                      ::unlink(path.c_str()) == 0;
    ::close(descriptor);
    return left;
  }

  fs::path path_;
  std::optional<FileBuffer> buffer_;
};

/// Copies owner, group and permissions of the file to be replaced, as far as the system allows. If
/// the group cannot be kept, its permissions are limited to those of others.
void take_permissions(int descriptor, const fs::path& from) {
  struct stat there {};
  if (::stat(from.c_str(), &there) != 0) return;
  mode_t mode = there.st_mode & (S_IRWXU | S_IRWXG | S_IRWXO);
  // Private first, because after fchown() this process may not be allowed to chmod.
  static_cast<void>(::fchmod(descriptor, mode & S_IRWXU));
  if (::fchown(descriptor, there.st_uid, there.st_gid) != 0 &&
      ::fchown(descriptor, static_cast<uid_t>(-1), there.st_gid) != 0)
    mode &= ~static_cast<mode_t>(S_IRWXG) | (mode & S_IRWXO) << 3;
  static_cast<void>(::fchmod(descriptor, mode));
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

void write_stream(const fs::path& file, const Target& target,
                  const std::function<void(std::ostream&)>& write) {
  const int descriptor = target.own_descriptor
                             ? ::fcntl(*target.own_descriptor, F_DUPFD_CLOEXEC, 0)
                             : ::open(target.file.c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC);
  if (descriptor < 0) fail(file, "open");
  FileBuffer buffer(descriptor, std::ios::out | std::ios::binary);
  fill(buffer, file, write);
}

}  // namespace

Writing writing_of(const fs::path& file) {
  return resolve(file).writing;
}

void write_atomically(const fs::path& file, const std::function<void(std::ostream&)>& write) {
  const Target target = resolve(file);
  if (target.writing == Writing::kStreams) return write_stream(file, target, write);
  Temporary temporary(file, target.file);
  take_permissions(temporary.buffer().fd(), target.file);
  fill(temporary.buffer(), file, write);
  temporary.rename_to(target.file);
}

void rename_into_place(const fs::path& temporary, const fs::path& file) {
  struct stat there {};
  if (::lstat(file.c_str(), &there) == 0 && !S_ISREG(there.st_mode) && !S_ISLNK(there.st_mode))
    throw Error(file.string(), ": is a ", kind_of(fs::symlink_status(file).type()),
                ", which a file cannot replace");
  if (::rename(temporary.c_str(), file.c_str()) != 0) fail(file, "rename into place");
}

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

void make_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw Error(folder.string(), ": cannot create the folder: ", error.message());
}

}  // namespace revisit
