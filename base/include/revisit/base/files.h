#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <ostream>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "revisit/base/error.h"

namespace revisit {

/// Throws InputError if the file is unreadable or not regular (a pipe could block forever).
std::string read_content(const std::filesystem::path& file);

/// Reads the first `most` bytes, or all if there are fewer. Throws like read_content().
std::string read_head(const std::filesystem::path& file, size_t most);

/// Returns "" if read_content() would throw.
std::string content_if_any(const std::filesystem::path& file);

/// Checks the target of write_atomically() before long work. Returns false if it is written
/// directly. Throws UsageError for a folder, a device, a socket; Error without a folder for it.
bool check_target(const std::filesystem::path& file);

/// Writes a file atomically: fills a temporary file in the same folder (NAME.*.part), flushes it to
/// disk and renames it. A symbolic link stays; its target is replaced. The new file keeps the
/// permissions of the old one. Any number of threads and processes may write to one target; the
/// last one wins. FIFOs, character devices (/dev/null) and /dev/stdout are written directly. Throws
/// UsageError as check_target(), and Error with the file and the reason; the temporary file is then
/// removed.
void write_atomically(const std::filesystem::path& file,
                      const std::function<void(std::ostream&)>& write);

/// Throws Error with the reason, also if `file` is neither regular nor a symbolic link, because a
/// rename would destroy a device or FIFO.
void rename_into_place(const std::filesystem::path& temporary, const std::filesystem::path& file);

/// Creates missing parents, too. Throws Error with the folder and the reason.
void make_folder(const std::filesystem::path& folder);

/// Returns whether `file` itself, not a link, is the file that `descriptor` is opened on.
bool is_named(int descriptor, const std::filesystem::path& file);

/// Makes this process the only writer of `part`, a file that is renamed when complete. The lock
/// ends when `descriptor`, opened on the file, is closed, also by a kill. Throws Error if another
/// process is writing the file or has just finished it.
void lock_part(int descriptor, const std::filesystem::path& part);

/// Reads a regular file, or one in memory, at any position and counts the bytes read. The buffer
/// starts small after a seek and doubles during sequential reads, so that skipping through a large
/// file reads little of it. Throws InputError, `path: ...`, if the file cannot be opened, is not a
/// regular file, or shrinks while it is read.
class FileCursor {
 public:
  explicit FileCursor(const std::filesystem::path& file);  ///< at position 0
  /// Reads `content`, which must outlive the cursor; `name` is the path in messages.
  FileCursor(std::string_view content, std::filesystem::path name);

  const std::filesystem::path& file() const { return file_; }  ///< path, or the name given for it
  uint64_t size() const { return size_; }                      ///< [bytes]
  uint64_t bytes_read() const { return bytes_read_; }          ///< from the disk so far

  uint64_t position() const { return position_; }         ///< [bytes] of the next read()
  void seek(uint64_t position) { position_ = position; }  ///< reads nothing yet

  /// The caller must have checked that the file has `n` more bytes.
  void read(void* destination, uint64_t n);
  uint8_t read_byte();  ///< like read(), one byte

 private:
  bool buffered() const;
  void refill();
  void read_at(uint64_t position, void* destination, uint64_t n);

  std::filesystem::path file_;
  std::shared_ptr<const int> descriptor_;  ///< null: the file is in memory
  std::string_view content_;
  uint64_t size_ = 0;
  uint64_t position_ = 0;
  uint64_t bytes_read_ = 0;
  std::vector<uint8_t> buffer_;
  uint64_t buffer_begin_ = 0;  ///< [bytes] offset of buffer_ in the file
};

/// An unnamed temporary file for data that need not stay in memory, in TMPDIR, else /var/tmp or
/// /tmp. It is deleted with this object or at process exit.
class UnnamedFile {
 public:
  /// Throws Error if the file cannot be created.
  UnnamedFile();
  ~UnnamedFile();
  UnnamedFile(const UnnamedFile&) = delete;
  UnnamedFile& operator=(const UnnamedFile&) = delete;

  /// Returns the offset of the appended bytes. Throws Error if the write fails, or in a forked
  /// process, because parent and child would write to the same file; nothing is appended then.
  int64_t append(std::span<const std::byte> bytes);
  /// Fills `bytes` from offset `at`. Thread-safe. Throws Error.
  void read(int64_t at, std::span<std::byte> bytes) const;

 private:
  int file_ = -1;
  int owner_;  ///< process
  int64_t size_ = 0;
};

/// Type of a number in a binary file.
struct NumberType {
  char kind = '?';          ///< as in NumPy: 'f' float, 'i' signed, 'u' unsigned; '?' another type
  size_t bytes = 0;         ///< size of a number
  bool big_endian = false;  ///< most significant byte first
};

/// Reads the number at an address, which need not be aligned.
using NumberReader = double (*)(const char*);

/// Returns null unless the type is a float of 4 or 8 bytes or an integer of 1, 2, 4 or 8 bytes.
NumberReader number_reader(const NumberType& type);

}  // namespace revisit
