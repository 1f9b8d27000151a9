#include "revisit/recognition/feature_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <limits>
#include <string_view>
#include <utility>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/hash.h"
#include "revisit/proto/npy.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;
static_assert(std::endian::native == std::endian::little, "features are stored little-endian");

constexpr auto kFloat = static_cast<int64_t>(sizeof(float));

/// Start of a file of features; the key follows, then zeros up to a multiple of its size.
struct FileStart {
  std::array<char, 32> magic{};
  int64_t n = 0, d = 0, extra = 0, key_bytes = 0;

  /// Bytes before the rows.
  int64_t bytes() const {
    constexpr int64_t kSize = sizeof(FileStart);
    return (2 * kSize + key_bytes - 1) / kSize * kSize;
  }
};
static_assert(sizeof(FileStart) == 64);
constexpr std::string_view kMagic = "revisit features, format 1\n";
constexpr int64_t kMaxCount = int64_t{1} << 40;

std::string header_of(FileStart start, const std::string& key) {
  kMagic.copy(start.magic.data(), kMagic.size());
  std::string header(static_cast<size_t>(start.bytes()), '\0');
  std::memcpy(header.data(), &start, sizeof start);
  key.copy(header.data() + sizeof start, key.size());
  return header;
}

bool fits(int64_t n, int64_t stride) {
  return n >= 0 && stride >= 0 &&
         (stride == 0 || n <= std::numeric_limits<int64_t>::max() / 16 / stride);
}

/// Checksum of a file without rows. A changed word always changes the checksum.
uint64_t checksum_of_shape(int64_t n_rows, int64_t dim) {
  return fnv1a(fnv1a(kFnv1aStart, static_cast<uint32_t>(n_rows)), static_cast<uint32_t>(dim));
}

/// Adds floats to the checksum, bit by bit: -0 and the kinds of NaN differ.
uint64_t with_floats(uint64_t checksum, std::span<const float> floats) {
  for (const float value : floats) checksum = fnv1a(checksum, std::bit_cast<uint32_t>(value));
  return checksum;
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

/// Writes `size` bytes at `offset`. Returns false on error; errno is set.
bool write_at(int descriptor, const void* data, int64_t size, int64_t offset) {
  int64_t done = 0;
  while (done < size) {
    const ssize_t written =
        ::pwrite(descriptor, static_cast<const char*>(data) + done, size - done, offset + done);
    if (written < 0 && errno != EINTR) return false;
    if (written > 0) done += written;
  }
  return true;
}

bool is_regular(int descriptor, int64_t* size) {
  struct stat status {};
  if (::fstat(descriptor, &status) != 0 || !S_ISREG(status.st_mode)) return false;
  *size = status.st_size;
  return true;
}

}  // namespace

FeatureWriter::FeatureWriter(fs::path file, const std::string& key, int64_t n_rows, int64_t dim,
                             int64_t extra)
    : file_(std::move(file)),
      part_(file_.string() + ".part"),
      n_rows_(n_rows),
      dim_(dim),
      extra_(extra) {
  if (dim < 1 || extra < 0 || !fits(n_rows, dim + extra))
    throw Error(file_.string(), ": cannot hold ", n_rows, " x ", dim, " floats");
  header_ = header_of({.n = n_rows, .d = dim, .extra = extra, .key_bytes = std::ssize(key)}, key);
  std::error_code ignored;
  fs::create_directories(file_.parent_path(), ignored);  // open() below reports the error
  descriptor_ = ::open(part_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
  if (descriptor_ < 0) throw Error(part_.string(), ": cannot create: ", std::strerror(errno));
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

int64_t FeatureWriter::written_bytes() const {
  return std::ssize(header_) + rows_ * (dim_ + extra_) * kFloat;
}

void FeatureWriter::continue_or_create() {
  lock_part(descriptor_, part_);
  int64_t size = 0;
  if (!is_regular(descriptor_, &size)) throw Error(part_.string(), ": is not a regular file");
  checksum_ = checksum_of_shape(n_rows_, dim_);
  std::string found(header_.size(), '\0');
  if (read_at(descriptor_, found.data(), std::ssize(found), 0) == std::ssize(found) &&
      found == header_) {
    std::vector<float> row(static_cast<size_t>(dim_ + extra_));
    const int64_t row_bytes = std::ssize(row) * kFloat;
    const int64_t available = std::min(n_rows_, (size - std::ssize(header_)) / row_bytes);
    for (; rows_ < available; ++rows_) {
      if (read_at(descriptor_, row.data(), row_bytes, written_bytes()) != row_bytes)
        fail("read a row of an earlier run");
      checksum_ = with_floats(checksum_, row);
    }
    if (::ftruncate(descriptor_, written_bytes()) != 0) fail("truncate an incomplete row");
    check_space();
    return;
  }
  // Old rows go before the new header is written, because a crash in between must not combine them.
  if (::ftruncate(descriptor_, 0) != 0) fail("empty it");
  check_space();
  if (!write_at(descriptor_, header_.data(), std::ssize(header_), 0)) fail("write");
}

int64_t FeatureWriter::missing_bytes() const {
  return (n_rows_ - rows_) * (dim_ + extra_) * kFloat;
}

void FeatureWriter::check_space() const {
  std::error_code error;
  const fs::space_info space = fs::space(part_, error);
  if (error || static_cast<uintmax_t>(missing_bytes()) <= space.available) return;
  throw Error(part_.string(), ": the ", n_rows_ - rows_, " remaining features need ",
              missing_bytes(), " bytes, but only ", space.available,
              " are free on that disk; free space or write them to another disk");
}

void FeatureWriter::append(std::span<const float> row, std::span<const float> extra) {
  if (std::ssize(row) != dim_ || std::ssize(extra) != extra_)
    throw Error(part_.string(), ": found a row of ", row.size() + extra.size(), " floats where ",
                dim_ + extra_, " are expected");
  if (rows_ == n_rows_) throw Error(part_.string(), ": more than the expected ", n_rows_, " rows");
  const int64_t at = written_bytes();
  if (!write_at(descriptor_, row.data(), dim_ * kFloat, at) ||
      !write_at(descriptor_, extra.data(), extra_ * kFloat, at + dim_ * kFloat))
    fail("write");
  checksum_ = with_floats(with_floats(checksum_, row), extra);
  ++rows_;
}

void FeatureWriter::fail(const std::string& doing) const {
  const int reason = errno;
  throw Error(part_.string(), ": cannot ", doing, ": ", std::strerror(reason), "; ", rows_, " of ",
              n_rows_, " features are written, the others need ", missing_bytes(),
              " bytes; run again to resume");
}

void FeatureWriter::finish() {
  if (rows_ != n_rows_)
    throw Error(part_.string(), ": only ", rows_, " of ", n_rows_, " features are written");
  if (!write_at(descriptor_, &checksum_, sizeof checksum_, written_bytes())) fail("write");
  if (::fsync(descriptor_) != 0) fail("flush to disk");
  rename_into_place(part_, file_);
  ::close(std::exchange(descriptor_, -1));
}

bool features_complete(const fs::path& file, const std::string& key) {
  try {
    const FeatureFile features(file);
    if (!features.is_written_ || features.key_ != key) return false;
    uint64_t checksum = checksum_of_shape(features.n_, features.d_), expected = 0;
    std::vector<float> row(static_cast<size_t>(features.stride_));
    for (int64_t i = 0; i < features.n_; ++i) {
      features.read(i, 0, features.stride_, row.data());
      checksum = with_floats(checksum, row);
    }
    std::memcpy(&expected, features.data_.get() + features.n_ * features.stride_, sizeof expected);
    return checksum == expected;
  } catch (const InputError&) {
    return false;
  }
}

FeatureFile::FeatureFile(fs::path file) : file_(std::move(file)) {
  const int opened =
      ::open(file_.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);  // a pipe would block
  if (opened < 0) throw InputError(file_.string(), ": cannot open: ", std::strerror(errno));
  descriptor_.reset(new int(opened), [](const int* descriptor) {
    ::close(*descriptor);
    delete descriptor;
  });
  int64_t size = 0;
  if (!is_regular(opened, &size)) throw InputError(file_.string(), ": is not a regular file");
  read_header(size);
  const int64_t checksum_bytes = is_written_ ? sizeof(uint64_t) : 0;
  if (!fits(n_, stride_) || size != header_bytes_ + n_ * stride_ * kFloat + checksum_bytes)
    throw InputError(file_.string(), ": the header says ", n_, " x ", stride_, " floats after ",
                     header_bytes_, " bytes, but the file has ", size,
                     " bytes; it was truncated or changed, regenerate it");
  if (header_bytes_ % kFloat != 0)
    throw InputError(file_.string(), ": the data starts at byte ", header_bytes_,
                     ", not a multiple of 4");
  const auto bytes = static_cast<size_t>(size);
  void* const mapped = ::mmap(nullptr, bytes, PROT_READ, MAP_PRIVATE, opened, 0);
  if (mapped == MAP_FAILED) {
    if (errno == ENOMEM) throw std::bad_alloc();  // the file is valid
    throw InputError(file_.string(), ": cannot map into memory: ", std::strerror(errno));
  }
  const std::shared_ptr<void> mapping(mapped, [bytes](void* start) { ::munmap(start, bytes); });
  const void* const data = static_cast<const char*>(mapped) + header_bytes_;
  data_ = {mapping, static_cast<const float*>(data)};
}

/// Reads the header of the open file, because its name may refer to another file by now.
void FeatureFile::read_header(int64_t size) {
  std::string start(proto::kMaxNpyHeader + 12, '\0');  // 12: magic, version and length
  const int64_t got = read_at(*descriptor_, start.data(), std::ssize(start), 0);
  if (got < 0) throw InputError(file_.string(), ": cannot read: ", std::strerror(errno));
  start.resize(static_cast<size_t>(got));
  if (start.starts_with(kMagic) && start.size() >= sizeof(FileStart)) {
    FileStart found;
    std::memcpy(&found, start.data(), sizeof found);
    for (const int64_t count : {found.n, found.d, found.extra, found.key_bytes})
      if (count < 0 || count > kMaxCount)
        throw InputError(file_.string(), ": not a feature file: its header is corrupt");
    is_written_ = true;
    n_ = found.n;
    d_ = found.d;
    stride_ = found.d + found.extra;
    header_bytes_ = found.bytes();
    if (header_bytes_ > size) return;  // the caller reports the size
    key_.resize(static_cast<size_t>(found.key_bytes));
    read_at(*descriptor_, key_.data(), found.key_bytes, sizeof found);
    return;
  }
  FileCursor cursor(start, file_);
  const std::vector<int64_t> shape = proto::read_npy_header(cursor);
  if (shape.size() != 2)
    throw InputError(file_.string(), ": not a feature file: expected two axes, found ",
                     shape.size());
  n_ = shape[0];
  stride_ = d_ = shape[1];
  header_bytes_ = static_cast<int64_t>(cursor.position());
}

FloatMatrix FeatureFile::matrix(int64_t first, int64_t count, int64_t columns) const {
  FloatMatrix matrix(count, columns);
  for (int64_t i = 0; i < count; ++i) read(first + i, 0, columns, matrix.row(i).data());
  return matrix;
}

void FeatureFile::read(int64_t i, int64_t first, int64_t count, float* out) const {
  const int64_t bytes = count * kFloat, offset = header_bytes_ + (i * stride_ + first) * kFloat;
  const int64_t got = read_at(*descriptor_, out, bytes, offset);
  if (got < 0)
    throw InputError(file_.string(), ": byte ", offset, ": cannot read: ", std::strerror(errno));
  if (got < bytes)
    throw InputError(file_.string(), ": byte ", offset + got,
                     ": the file was truncated while it was read");
}

}  // namespace revisit
