#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>
#include <utility>
#include <vector>

#include "revisit/base/error.h"

namespace revisit {

/// A malformed position in a file. Callers rethrow it as InputError with the path and the field.
struct FormatError : Error {
  template <class... Parts>
  explicit FormatError(uint64_t at, const Parts&... reason) : Error(reason...), offset(at) {}
  uint64_t offset;  // [bytes] from the beginning of the file
};

/// Reads a regular file, or one in memory, at any position and counts the bytes read. The buffer
/// starts small after a seek and doubles during sequential reads, so that skipping through a large
/// file reads little of it. Throws InputError, `path: ...`, if the file cannot be opened, is not a
/// regular file, or shrinks while it is read.
class FileCursor {
 public:
  explicit FileCursor(const std::filesystem::path& file);
  /// Reads `content`, which must outlive the cursor; `name` is the path in messages.
  FileCursor(std::string_view content, std::filesystem::path name);

  const std::filesystem::path& file() const { return file_; }
  uint64_t size() const { return size_; }
  uint64_t bytes_read() const { return bytes_read_; }

  uint64_t position() const { return position_; }
  void seek(uint64_t position) { position_ = position; }

  /// The caller must have checked that the file has `n` more bytes.
  void read(void* destination, uint64_t n);
  uint8_t read_byte();

 private:
  bool buffered() const;
  void refill();
  void read_at(uint64_t position, void* destination, uint64_t n);

  struct Descriptor {
    int number = -1;
    explicit Descriptor(int opened = -1) : number(opened) {}
    Descriptor(Descriptor&& other) noexcept : number(std::exchange(other.number, -1)) {}
    Descriptor& operator=(Descriptor&& other) noexcept {
      std::swap(number, other.number);
      return *this;
    }
    ~Descriptor();
  };

  std::filesystem::path file_;
  Descriptor descriptor_;  // none: the file is in memory
  std::string_view content_;
  uint64_t size_ = 0;
  uint64_t position_ = 0;
  uint64_t bytes_read_ = 0;
  std::vector<uint8_t> buffer_;
  uint64_t buffer_begin_ = 0;  // [bytes] offset of buffer_ in the file
};

}  // namespace revisit
