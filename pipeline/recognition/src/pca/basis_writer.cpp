#include "basis_writer.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "feature/read_write_at.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/proto/npy.h"

namespace revisit {
BasisWriter::BasisWriter(std::filesystem::path file, int64_t rows, int64_t columns)
    : file_(std::move(file)), part_(file_.string() + ".part"), rows_(rows), columns_(columns) {
  const std::string header = proto::npy_header({rows, columns});
  header_bytes_ = static_cast<int64_t>(header.size());
  descriptor_ = ::open(part_.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0666);
  if (descriptor_ < 0) fail("create", errno);
  try {
    lock_part(descriptor_, part_);
  } catch (...) {
    ::close(descriptor_);
    throw;
  }
  const int64_t size = header_bytes_ + rows * columns * static_cast<int64_t>(sizeof(float));
  int error = ::ftruncate(descriptor_, 0) != 0 ? errno : ::posix_fallocate(descriptor_, 0, size);
  if (error == 0 && !write_at(descriptor_, header.data(), header_bytes_, 0)) error = errno;
  if (error == 0) return;
  ::close(descriptor_);
  ::unlink(part_.c_str());
  fail("write", error);
}

BasisWriter::~BasisWriter() {
  if (descriptor_ < 0) return;
  ::close(descriptor_);
  ::unlink(part_.c_str());
}

void BasisWriter::fail(const char* doing, int reason) const {
  throw Error(file_.string(), ": cannot ", doing, ": ", std::strerror(reason), " (",
              rows_ * columns_ * static_cast<int64_t>(sizeof(float)), " bytes needed)");
}

void BasisWriter::write(int64_t first, int64_t count, const float* values) {
  constexpr int64_t kSize = sizeof(float);
  for (int64_t r = 0; r < rows_; ++r) {
    const int64_t offset = header_bytes_ + (r * columns_ + first) * kSize;
    if (!write_at(descriptor_, values + r * count, count * kSize, offset)) fail("write", errno);
  }
}

void BasisWriter::finish() {
  if (::fsync(descriptor_) != 0) fail("flush", errno);
  rename_into_place(part_, file_);
  ::close(std::exchange(descriptor_, -1));
}

}  // namespace revisit
