#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>
#include <utility>
#include <vector>

#include "revisit/base/error.h"

namespace revisit {

/// A broken place in a file. Becomes an InputError once the path and what was read are known.
struct FormatError : Error {
  template <class... Parts>
  explicit FormatError(uint64_t at, const Parts&... reason) : Error(reason...), offset(at) {}
  uint64_t offset;  // [bytes] from the beginning of the file
};

/// Reads a regular file, or one in memory, at any position and counts what it really read. The
/// buffer starts small after a jump and doubles while reading goes on: hopping from field to field
/// of a large file reads little of it. Throws InputError, `path: ...`, when the file cannot be
/// opened, is not a regular file, or becomes shorter while it is read.
class FileCursor {
 public:
  explicit FileCursor(const std::filesystem::path& file);
  /// Reads `content`, which must outlive the cursor; `name` stands for the path.
  FileCursor(std::string_view content, std::filesystem::path name);

  const std::filesystem::path& file() const { return file_; }
  uint64_t size() const { return size_; }
  uint64_t bytes_read() const { return bytes_read_; }

  uint64_t position() const { return position_; }
  void seek(uint64_t position) { position_ = position; }

  /// The next `n` bytes. The caller has checked that the file has them.
  void read(void* destination, uint64_t n);
  uint8_t read_byte();

 private:
  bool buffered() const;
  void refill();
  void read_at(uint64_t position, void* destination, uint64_t n);

  struct Descriptor {
    int number = -1;  // -1: none
    explicit Descriptor(int opened = -1) : number(opened) {}
    Descriptor(Descriptor&& other) noexcept : number(std::exchange(other.number, -1)) {}
    Descriptor& operator=(Descriptor&& other) noexcept {
      std::swap(number, other.number);
      return *this;
    }
    ~Descriptor();
  };

  std::filesystem::path file_;
  Descriptor descriptor_;     // none: what is read is in memory,
  std::string_view content_;  // here
  uint64_t size_ = 0;
  uint64_t position_ = 0;
  uint64_t bytes_read_ = 0;
  std::vector<uint8_t> buffer_;
  uint64_t buffer_begin_ = 0;  // [bytes] where buffer_ lies in the file
};

}  // namespace revisit
