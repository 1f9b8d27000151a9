#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <limits>

#include "revisit/base/files.h"

namespace revisit {
namespace {

constexpr uint64_t kFirstRefill = 512;
constexpr uint64_t kMaxRefill = 64 * 1024;

void close_and_delete(const int* descriptor) {
  ::close(*descriptor);
  delete descriptor;
}

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

}  // namespace revisit
