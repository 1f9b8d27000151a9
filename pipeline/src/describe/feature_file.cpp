#include "revisit/pipeline/feature_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <bit>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <regex>
#include <utility>

#include "io/part_lock.h"
#include "revisit/proto/atomic_file.h"
#include "revisit/proto/error.h"
#include "revisit/proto/npy.h"

namespace revisit::pipeline {
namespace {

namespace fs = std::filesystem;
static_assert(std::endian::native == std::endian::little, "features are stored little-endian");

std::string with_suffix(const fs::path& file, const char* suffix) {
  return file.string() + suffix;
}

std::string content_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// Reads `size` bytes at `offset`, or fewer at the end of the file; -1 on error.
int64_t read_at(int descriptor, void* out, int64_t size, int64_t offset) {
  int64_t done = 0;
  while (done < size) {
    const ssize_t got =
        ::pread(descriptor, static_cast<char*>(out) + done, size - done, offset + done);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return -1;
    if (got == 0) break;
    done += got;
  }
  return done;
}

bool is_regular(int descriptor, int64_t* size) {
  struct stat status {};
  if (::fstat(descriptor, &status) != 0 || !S_ISREG(status.st_mode)) return false;
  *size = status.st_size;
  return true;
}

void sync_folder(const fs::path& folder) {
  const int descriptor =
      ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;  // the data is safe; only the name could be lost with the power
  ::fsync(descriptor);
  ::close(descriptor);
}

struct Header {
  int64_t n = 0, d = 0, bytes = 0;
};

/// The header of a float32 .npy with two axes (NumPy's format, versions 1 to 3).
Header parse_header(const fs::path& file, int descriptor) {
  const auto bad = [&](const std::string& why) -> InputError {
    return InputError(
        str(file.string(), ": not a feature file (a float32 .npy with two axes): ", why));
  };
  unsigned char start[12] = {};
  const int64_t got = read_at(descriptor, start, sizeof start, 0);
  if (got < 0) throw InputError(str(file.string(), ": cannot read: ", std::strerror(errno)));
  if (got < 12 || std::memcmp(start, "\x93NUMPY", 6) != 0) throw bad("no NumPy header at byte 0");
  if (start[6] < 1 || start[6] > 3)
    throw bad(str("format version ", int{start[6]}, ", expected 1 to 3"));
  int64_t length = start[8] | start[9] << 8;
  const int64_t prefix = start[6] == 1 ? 10 : 12;
  if (prefix == 12) length |= int64_t{start[10]} << 16 | int64_t{start[11]} << 24;
  constexpr int64_t kLongestHeader = 1 << 16;
  if (length > kLongestHeader) throw bad(str("a header of ", length, " bytes"));
  std::string text(length, '\0');
  if (read_at(descriptor, text.data(), length, prefix) != length)
    throw bad("the header is cut off");

  std::smatch found;
  if (!std::regex_search(text, found, std::regex("'descr': *'([^']*)'")) || found[1] != "<f4")
    throw bad(str("its type is '", found.size() > 1 ? found[1].str() : "?", "', expected '<f4'"));
  if (!std::regex_search(text, std::regex("'fortran_order': *False")))
    throw bad("it is not in C order");
  if (!std::regex_search(text, found,
                         std::regex("'shape': *\\(([0-9]{1,15}), *([0-9]{1,15}),? *\\)")))
    throw bad(str("header '", text.substr(0, text.find_last_not_of(" \n") + 1), "'"));
  return {std::stoll(found[1]), std::stoll(found[2]), prefix + length};
}

}  // namespace

FeatureWriter::FeatureWriter(fs::path file, std::string key, int64_t n_rows, int64_t dim)
    : file_(std::move(file)),
      part_(with_suffix(file_, ".part")),
      part_key_(with_suffix(file_, ".part.key")),
      key_(std::move(key)),
      n_rows_(n_rows),
      dim_(dim) {
  if (n_rows < 0 || dim < 1 || n_rows > std::numeric_limits<int64_t>::max() / 16 / dim)
    throw Error(str(file_.string(), ": cannot hold ", n_rows, " x ", dim, " floats"));
  header_ = proto::npy_header({n_rows, dim});
  std::error_code ignored;
  fs::create_directories(file_.parent_path(), ignored);  // open() below says what is wrong
  descriptor_ = ::open(part_.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0666);
  if (descriptor_ < 0) throw Error(str(part_.string(), ": cannot create: ", std::strerror(errno)));
  try {
    continue_or_create();
  } catch (...) {
    ::close(descriptor_);
    throw;
  }
}

FeatureWriter::~FeatureWriter() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void FeatureWriter::continue_or_create() {
  lock_part(descriptor_, part_);
  int64_t size = 0;
  if (!is_regular(descriptor_, &size)) throw Error(str(part_.string(), ": is not a regular file"));
  const auto header_bytes = static_cast<int64_t>(header_.size());
  const int64_t row_bytes = dim_ * static_cast<int64_t>(sizeof(float));
  std::string found(header_.size(), '\0');
  const bool same =
      fs::exists(part_key_) && content_of(part_key_) == key_ && size >= header_bytes &&
      read_at(descriptor_, found.data(), header_bytes, 0) == header_bytes && found == header_;
  if (same) {
    rows_ = std::min(n_rows_, (size - header_bytes) / row_bytes);
    if (::ftruncate(descriptor_, header_bytes + rows_ * row_bytes) != 0) fail("cut off a torn row");
    if (::lseek(descriptor_, 0, SEEK_END) < 0) fail("go to the end");
    check_space();
    return;
  }
  // The old rows go before the new key comes: a crash in between must not marry them.
  if (::ftruncate(descriptor_, 0) != 0) fail("empty it");
  std::error_code ignored;
  fs::remove(part_key_, ignored);
  check_space();
  write_all(header_.data(), header_.size());
  write_atomically(part_key_, [this](std::ostream& out) { out << key_; });
}

void FeatureWriter::check_space() const {
  const int64_t needed = (n_rows_ - rows_) * dim_ * static_cast<int64_t>(sizeof(float));
  std::error_code error;
  const fs::space_info space = fs::space(part_, error);
  if (error || static_cast<uintmax_t>(needed) <= space.available) return;
  throw Error(str(part_.string(), ": the ", n_rows_ - rows_, " features to come need ", needed,
                  " bytes, but only ", space.available,
                  " are free on that disk; make room or use another --output"));
}

void FeatureWriter::append(std::span<const float> row) {
  if (static_cast<int64_t>(row.size()) != dim_)
    throw Error(
        str(part_.string(), ": a row of ", row.size(), " floats where ", dim_, " were announced"));
  if (rows_ == n_rows_)
    throw Error(str(part_.string(), ": more than the announced ", n_rows_, " rows"));
  write_all(row.data(), row.size_bytes());
  ++rows_;
}

void FeatureWriter::write_all(const void* data, size_t size) {
  const char* next = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t written = ::write(descriptor_, next, size);
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) {
      const int reason = errno;
      // A retry would append behind the torn row; without it, it continues where the file is whole.
      const int64_t whole =
          rows_ * dim_ * static_cast<int64_t>(sizeof(float)) + static_cast<int64_t>(header_.size());
      if (::ftruncate(descriptor_, whole) == 0) ::lseek(descriptor_, 0, SEEK_END);
      errno = reason;
      fail("write");
    }
    next += written;
    size -= static_cast<size_t>(written);
  }
}

void FeatureWriter::fail(const std::string& doing) const {
  const int reason = errno;
  throw Error(str(part_.string(), ": cannot ", doing, ": ", std::strerror(reason), "; ", rows_,
                  " of ", n_rows_, " features are written, the rest needs ",
                  (n_rows_ - rows_) * dim_ * static_cast<int64_t>(sizeof(float)),
                  " bytes; run again to continue"));
}

void FeatureWriter::finish() {
  if (rows_ != n_rows_)
    throw Error(str(part_.string(), ": only ", rows_, " of ", n_rows_, " features are written"));
  if (::fsync(descriptor_) != 0) fail("flush to disk");
  // The old key goes before the new rows come, for the same reason as above.
  const fs::path key_file = with_suffix(file_, ".key");
  std::error_code ignored;
  fs::remove(key_file, ignored);
  rename_into_place(part_, file_);
  rename_into_place(part_key_, key_file);
  sync_folder(file_.parent_path());
  ::close(std::exchange(descriptor_, -1));
}

bool features_complete(const fs::path& file, const std::string& key) {
  const fs::path key_file = with_suffix(file, ".key");
  return fs::exists(file) && fs::exists(key_file) && content_of(key_file) == key;
}

FeatureFile::FeatureFile(fs::path file) : file_(std::move(file)) {
  descriptor_ = ::open(file_.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor_ < 0)
    throw InputError(str(file_.string(), ": cannot open: ", std::strerror(errno)));
  try {
    if (!is_regular(descriptor_, &mapped_bytes_))
      throw InputError(str(file_.string(), ": is not a regular file"));
    const Header header = parse_header(file_, descriptor_);
    n_ = header.n;
    d_ = header.d;
    header_bytes_ = header.bytes;
    const bool fits = d_ == 0 || n_ <= std::numeric_limits<int64_t>::max() / 16 / d_;
    if (!fits || mapped_bytes_ != header_bytes_ + n_ * d_ * static_cast<int64_t>(sizeof(float)))
      throw InputError(str(file_.string(), ": the header says ", n_, " x ", d_, " floats after ",
                           header_bytes_, " bytes, but the file has ", mapped_bytes_,
                           " bytes; it was cut off or changed, make it anew"));
    if (header_bytes_ % static_cast<int64_t>(alignof(float)) != 0)
      throw InputError(str(file_.string(), ": the data starts at byte ", header_bytes_,
                           ", not a multiple of 4"));
    mapping_ =
        ::mmap(nullptr, static_cast<size_t>(mapped_bytes_), PROT_READ, MAP_PRIVATE, descriptor_, 0);
    if (mapping_ == MAP_FAILED) {
      mapping_ = nullptr;
      throw InputError(str(file_.string(), ": cannot map into memory: ", std::strerror(errno)));
    }
    data_ = static_cast<const float*>(
        static_cast<const void*>(static_cast<const char*>(mapping_) + header_bytes_));
  } catch (...) {
    close();
    throw;
  }
}

FeatureFile::~FeatureFile() {
  close();
}

FeatureFile::FeatureFile(FeatureFile&& other) noexcept {
  *this = std::move(other);
}

FeatureFile& FeatureFile::operator=(FeatureFile&& other) noexcept {
  if (this == &other) return *this;
  close();
  file_ = std::move(other.file_);
  n_ = std::exchange(other.n_, 0);
  d_ = std::exchange(other.d_, 0);
  header_bytes_ = other.header_bytes_;
  mapped_bytes_ = other.mapped_bytes_;
  descriptor_ = std::exchange(other.descriptor_, -1);
  mapping_ = std::exchange(other.mapping_, nullptr);
  data_ = std::exchange(other.data_, nullptr);
  return *this;
}

void FeatureFile::close() noexcept {
  if (mapping_) ::munmap(std::exchange(mapping_, nullptr), static_cast<size_t>(mapped_bytes_));
  if (descriptor_ >= 0) ::close(std::exchange(descriptor_, -1));
}

void FeatureFile::read(int64_t i, int64_t first, int64_t count, float* out) const {
  const auto bytes = count * static_cast<int64_t>(sizeof(float));
  const int64_t offset = header_bytes_ + (i * d_ + first) * static_cast<int64_t>(sizeof(float));
  const int64_t got = read_at(descriptor_, out, bytes, offset);
  if (got < 0)
    throw InputError(
        str(file_.string(), ": byte ", offset, ": cannot read: ", std::strerror(errno)));
  if (got < bytes)
    throw InputError(str(file_.string(), ": byte ", offset + got,
                         ": the file became shorter while it was read"));
}

}  // namespace revisit::pipeline
