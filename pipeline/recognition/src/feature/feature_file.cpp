#include "revisit/recognition/feature_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <bit>
#include <cerrno>
#include <cstring>
#include <limits>
#include <sstream>
#include <string_view>
#include <utility>
#include <vector>

#include "feature/read_write_at.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/hash.h"
#include "revisit/proto/npy.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;
static_assert(std::endian::native == std::endian::little, "features are stored little-endian");

std::string with_suffix(const fs::path& file, const char* suffix) {
  return file.string() + suffix;
}

/// Checksum of a file without rows. A changed word always changes the checksum.
uint64_t checksum_of_shape(int64_t n_rows, int64_t dim) {
  return fnv1a(fnv1a(kFnv1aStart, static_cast<uint32_t>(n_rows)), static_cast<uint32_t>(dim));
}

/// Adds a row to the checksum, bit by bit: -0 and the kinds of NaN differ.
uint64_t with_row(uint64_t checksum, std::span<const float> row) {
  for (const float value : row) checksum = fnv1a(checksum, std::bit_cast<uint32_t>(value));
  return checksum;
}

std::string before_checksum(const std::string& key) {
  return key + "\nchecksum ";
}

std::string finished_key(const std::string& key, uint64_t checksum) {
  std::ostringstream text;
  text << before_checksum(key) << std::hex << checksum << "\n";
  return std::move(text).str();
}

bool is_regular(int descriptor, int64_t* size) {
  struct stat status {};
  if (::fstat(descriptor, &status) != 0 || !S_ISREG(status.st_mode)) return false;
  *size = status.st_size;
  return true;
}

/// Reads the header of the open file, because its name may refer to another file by now.
proto::NpyHeader read_header(const fs::path& file, int descriptor) {
  std::string start(proto::kMaxNpyHeader + 12, '\0');  // 12: magic, version and length
  const int64_t got = read_at(descriptor, start.data(), static_cast<int64_t>(start.size()), 0);
  if (got < 0) throw InputError(file.string(), ": cannot read: ", std::strerror(errno));
  FileCursor cursor(std::string_view(start).substr(0, static_cast<size_t>(got)), file);
  proto::NpyHeader header = proto::read_npy_header(cursor);
  if (header.dtype == "<f4" && !header.fortran_order && header.shape.size() == 2) return header;
  throw InputError(file.string(),
                   ": not a feature file: expected '<f4' in C order with two "
                   "axes, found '",
                   header.dtype, "' in ", header.fortran_order ? "Fortran" : "C", " order with ",
                   header.shape.size());
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
    throw Error(file_.string(), ": cannot hold ", n_rows, " x ", dim, " floats");
  header_ = proto::npy_header({n_rows, dim});
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

/// A finished key in a part's place belongs to a run that was killed between the two renames.
bool FeatureWriter::continues_part(int64_t size) const {
  const std::string key = content_if_any(part_key_);
  if (key != key_ && !key.starts_with(before_checksum(key_))) return false;
  const auto header_bytes = static_cast<int64_t>(header_.size());
  std::string found(header_.size(), '\0');
  return size >= header_bytes &&
         read_at(descriptor_, found.data(), header_bytes, 0) == header_bytes && found == header_;
}

int64_t FeatureWriter::written_bytes() const {
  return static_cast<int64_t>(header_.size()) + rows_ * dim_ * static_cast<int64_t>(sizeof(float));
}

void FeatureWriter::continue_or_create() {
  lock_part(descriptor_, part_);
  int64_t size = 0;
  if (!is_regular(descriptor_, &size)) throw Error(part_.string(), ": is not a regular file");
  checksum_ = checksum_of_shape(n_rows_, dim_);
  if (continues_part(size)) {
    const int64_t row_bytes = dim_ * static_cast<int64_t>(sizeof(float));
    const int64_t there =
        std::min(n_rows_, (size - static_cast<int64_t>(header_.size())) / row_bytes);
    std::vector<float> row(static_cast<size_t>(dim_));
    for (; rows_ < there; ++rows_) {
      if (read_at(descriptor_, row.data(), row_bytes, written_bytes()) != row_bytes)
        fail("read a row of an earlier run");
      checksum_ = with_row(checksum_, row);
    }
    if (::ftruncate(descriptor_, written_bytes()) != 0) fail("truncate an incomplete row");
    check_space();
    return;
  }
  // Remove old rows before writing the new key, because a crash in between must not combine them.
  if (::ftruncate(descriptor_, 0) != 0) fail("empty it");
  std::error_code ignored;
  fs::remove(part_key_, ignored);
  check_space();
  if (!write_at(descriptor_, header_.data(), static_cast<int64_t>(header_.size()), 0))
    fail("write");
  write_atomically(part_key_, [this](std::ostream& out) { out << key_; });
}

void FeatureWriter::check_space() const {
  const int64_t needed = (n_rows_ - rows_) * dim_ * static_cast<int64_t>(sizeof(float));
  std::error_code error;
  const fs::space_info space = fs::space(part_, error);
  if (error || static_cast<uintmax_t>(needed) <= space.available) return;
  throw Error(part_.string(), ": the ", n_rows_ - rows_, " remaining features need ", needed,
              " bytes, but only ", space.available,
              " are free on that disk; free space or write them to another disk");
}

void FeatureWriter::append(std::span<const float> row) {
  if (static_cast<int64_t>(row.size()) != dim_)
    throw Error(part_.string(), ": found a row of ", row.size(), " floats where ", dim_,
                " are expected");
  if (rows_ == n_rows_) throw Error(part_.string(), ": more than the expected ", n_rows_, " rows");
  if (!write_at(descriptor_, row.data(), static_cast<int64_t>(row.size_bytes()), written_bytes()))
    fail("write");
  checksum_ = with_row(checksum_, row);
  ++rows_;
}

void FeatureWriter::fail(const std::string& doing) const {
  const int reason = errno;
  throw Error(part_.string(), ": cannot ", doing, ": ", std::strerror(reason), "; ", rows_, " of ",
              n_rows_, " features are written, the others need ",
              (n_rows_ - rows_) * dim_ * static_cast<int64_t>(sizeof(float)),
              " bytes; run again to resume");
}

void FeatureWriter::finish() {
  if (rows_ != n_rows_)
    throw Error(part_.string(), ": only ", rows_, " of ", n_rows_, " features are written");
  if (::fsync(descriptor_) != 0) fail("flush to disk");
  write_atomically(part_key_, [this](std::ostream& out) { out << finished_key(key_, checksum_); });
  // Remove the old key before the new rows appear, for the same reason as above.
  const fs::path key_file = with_suffix(file_, ".key");
  std::error_code ignored;
  fs::remove(key_file, ignored);
  rename_into_place(part_, file_);
  rename_into_place(part_key_, key_file);
  ::close(std::exchange(descriptor_, -1));
}

bool features_complete(const fs::path& file, const std::string& key) {
  std::string found = content_if_any(with_suffix(file, ".key"));
  // The run may have been killed between the two renames of finish().
  if (found.empty()) found = content_if_any(with_suffix(file, ".part.key"));
  if (!found.starts_with(before_checksum(key))) return false;
  try {
    const FeatureFile features(file);
    uint64_t checksum = checksum_of_shape(features.n(), features.d());
    std::vector<float> row(static_cast<size_t>(features.d()));
    for (int64_t i = 0; i < features.n(); ++i) {
      features.read(i, 0, features.d(), row.data());
      checksum = with_row(checksum, row);
    }
    return found == finished_key(key, checksum);
  } catch (const InputError&) {
    return false;
  }
}

FeatureFile::FeatureFile(fs::path file) : file_(std::move(file)) {
  descriptor_ = ::open(file_.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);  // a pipe would block
  if (descriptor_ < 0) throw InputError(file_.string(), ": cannot open: ", std::strerror(errno));
  try {
    if (!is_regular(descriptor_, &mapped_bytes_))
      throw InputError(file_.string(), ": is not a regular file");
    const proto::NpyHeader header = read_header(file_, descriptor_);
    n_ = header.shape[0];
    d_ = header.shape[1];
    header_bytes_ = static_cast<int64_t>(header.bytes);
    const bool fits = d_ == 0 || n_ <= std::numeric_limits<int64_t>::max() / 16 / d_;
    if (!fits || mapped_bytes_ != header_bytes_ + n_ * d_ * static_cast<int64_t>(sizeof(float)))
      throw InputError(file_.string(), ": the header says ", n_, " x ", d_, " floats after ",
                       header_bytes_, " bytes, but the file has ", mapped_bytes_,
                       " bytes; it was truncated or changed, regenerate it");
    if (header_bytes_ % static_cast<int64_t>(alignof(float)) != 0)
      throw InputError(file_.string(), ": the data starts at byte ", header_bytes_,
                       ", not a multiple of 4");
    mapping_ =
        ::mmap(nullptr, static_cast<size_t>(mapped_bytes_), PROT_READ, MAP_PRIVATE, descriptor_, 0);
    if (mapping_ == MAP_FAILED) {
      mapping_ = nullptr;
      if (errno == ENOMEM) throw std::bad_alloc();  // the file is valid
      throw InputError(file_.string(), ": cannot map into memory: ", std::strerror(errno));
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
    throw InputError(file_.string(), ": byte ", offset, ": cannot read: ", std::strerror(errno));
  if (got < bytes)
    throw InputError(file_.string(), ": byte ", offset + got,
                     ": the file was truncated while it was read");
}

}  // namespace revisit
