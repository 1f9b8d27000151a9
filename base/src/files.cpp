#include "revisit/base/files.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <string>
#include <type_traits>

static_assert(std::endian::native == std::endian::little, "only big-endian numbers are swapped");

namespace revisit {
namespace {

constexpr uint64_t kFirstRefill = 512;
constexpr uint64_t kMaxRefill = 64 * 1024;

void close_and_delete(const int* descriptor) {
  ::close(*descriptor);
  delete descriptor;
}

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

template <class Stored, bool kBigEndian>
double read(const char* bytes) {
  std::array<char, sizeof(Stored)> own;
  std::copy_n(bytes, own.size(), own.begin());
  if constexpr (kBigEndian) std::reverse(own.begin(), own.end());
  Stored value;
  std::memcpy(&value, own.data(), sizeof value);
  return static_cast<double>(value);
}

struct Known {
  char kind;
  size_t bytes;
  NumberReader little_endian, big_endian;
};

template <class Stored>
constexpr Known known() {
  return {std::is_floating_point_v<Stored> ? 'f'
          : std::is_signed_v<Stored>       ? 'i'
                                           : 'u',
          sizeof(Stored), read<Stored, false>, read<Stored, true>};
}

constexpr Known kKnown[] = {
    known<float>(),    known<double>(),  known<int8_t>(),   known<uint8_t>(), known<int16_t>(),
    known<uint16_t>(), known<int32_t>(), known<uint32_t>(), known<int64_t>(), known<uint64_t>()};

}  // namespace

FileCursor::FileCursor(const std::filesystem::path& file) : file_(file) {
  // O_NONBLOCK: opening a pipe without a writer would block forever.
  const int opened = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (opened < 0) throw InputError(file.string(), ": cannot open: ", std::strerror(errno));
  descriptor_ = std::shared_ptr<const int>(new int(opened), close_and_delete);
  struct stat status {};
  if (::fstat(opened, &status) != 0 || !S_ISREG(status.st_mode))
    throw InputError(file.string(), ": is ",
                     S_ISDIR(status.st_mode) ? "a folder" : "not a regular file",
                     ", expected a file");
  size_ = static_cast<uint64_t>(status.st_size);
}

FileCursor::FileCursor(std::string_view content, std::filesystem::path name)
    : file_(std::move(name)), content_(content), size_(content.size()) {}

bool FileCursor::buffered() const {
  return position_ >= buffer_begin_ && position_ - buffer_begin_ < buffer_.size();
}

void FileCursor::refill() {
  const bool goes_on = !buffer_.empty() && position_ == buffer_begin_ + buffer_.size();
  const uint64_t wanted =
      goes_on ? std::min<uint64_t>(2 * buffer_.size(), kMaxRefill) : kFirstRefill;
  const uint64_t left = size_ > position_ ? size_ - position_ : 0;
  buffer_.resize(std::min(wanted, left));
  buffer_begin_ = position_;
  read_at(position_, buffer_.data(), buffer_.size());
}

uint8_t FileCursor::read_byte() {
  uint8_t byte = 0;
  read(&byte, 1);
  return byte;
}

void FileCursor::read(void* destination, uint64_t n) {
  auto* out = static_cast<uint8_t*>(destination);
  while (n > 0) {
    if (!buffered()) {
      if (n >= kMaxRefill) {
        read_at(position_, out, n);
        position_ += n;
        return;
      }
      refill();
      if (buffer_.empty())
        throw InputError(file_.string(), ": byte ", position_, ": unexpected end of file");
    }
    const uint64_t skipped = position_ - buffer_begin_;
    const uint64_t taken = std::min<uint64_t>(n, buffer_.size() - skipped);
    std::memcpy(out, buffer_.data() + skipped, taken);
    out += taken;
    position_ += taken;
    n -= taken;
  }
}

void FileCursor::read_at(uint64_t position, void* destination, uint64_t n) {
  if (!descriptor_) {
    if (position > size_ || n > size_ - position)
      throw InputError(file_.string(), ": byte ", size_, ": unexpected end of file");
    std::memcpy(destination, content_.data() + position, n);
    bytes_read_ += n;
    return;
  }
  auto* out = static_cast<uint8_t*>(destination);
  while (n > 0) {
    const ssize_t got = ::pread(*descriptor_, out, n, static_cast<off_t>(position));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0)
      throw InputError(file_.string(), ": byte ", position, ": cannot read: ",
                       got < 0 ? std::strerror(errno) : "the file became shorter");
    out += got;
    position += static_cast<uint64_t>(got);
    n -= static_cast<uint64_t>(got);
    bytes_read_ += static_cast<uint64_t>(got);
  }
}

std::string read_head(const std::filesystem::path& file, size_t most) {
  FileCursor cursor(file);
  std::string head(std::min<uint64_t>(most, cursor.size()), '\0');
  cursor.read(head.data(), head.size());
  return head;
}

std::string read_content(const std::filesystem::path& file) {
  return read_head(file, std::numeric_limits<size_t>::max());
}

std::string content_if_any(const std::filesystem::path& file) {
  try {
    return read_content(file);
  } catch (const InputError&) {
    return "";
  }
}

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

NumberReader number_reader(const NumberType& type) {
  for (const Known& k : kKnown)
    if (k.kind == type.kind && k.bytes == type.bytes)
      return type.big_endian ? k.big_endian : k.little_endian;
  return nullptr;
}

}  // namespace revisit
