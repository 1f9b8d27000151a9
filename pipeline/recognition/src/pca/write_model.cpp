#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <utility>

#include "feature/read_write_at.h"
#include "feature_panels.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/engine/parallel_for.h"
#include "revisit/proto/npy.h"

namespace revisit {

/// Writes a float32 .npy `[rows][columns]` in blocks of columns, atomically.
class BasisWriter {
 public:
  /// Reserves the space. Throws Error if the disk has too little.
  BasisWriter(std::filesystem::path file, int64_t rows, int64_t columns);
  ~BasisWriter();  // without finish() the file is removed
  BasisWriter(const BasisWriter&) = delete;
  BasisWriter& operator=(const BasisWriter&) = delete;

  /// Writes columns [first, first + count) of all rows; `values` [rows][count].
  void write(int64_t first, int64_t count, const float* values);
  void finish();

 private:
  [[noreturn]] void fail(const char* doing, int reason) const;

  std::filesystem::path file_, part_;
  int64_t rows_, columns_, header_bytes_ = 0;
  int descriptor_ = -1;
};

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

namespace {

namespace fs = std::filesystem;

/// Returns L^(-1/2) U^T, [rank][m].
std::vector<float> basis_weights(const Eigenpairs& pairs, int64_t m, int64_t rank) {
  std::vector<float> weights(rank * m);
  for (int64_t i = 0; i < rank; ++i)
    for (int64_t r = 0; r < m; ++r)
      weights[i * m + r] =
          static_cast<float>(pairs.vectors[i * m + r] / std::sqrt(pairs.values[i]));
  return weights;
}

}  // namespace

void write_model(const StackedFeatures& features, const std::vector<int64_t>& fitted,
                 const Eigenpairs& pairs, int64_t rank, const PcaOptions& options) {
  constexpr int64_t kSize = sizeof(float);
  const int64_t d = features.d(), m = static_cast<int64_t>(fitted.size());
  const std::vector<float> weights = basis_weights(pairs, m, rank);
  const int64_t width = panel_columns(options.memory, rank * m * kSize, (m + rank) * kSize + 16, d);

  std::error_code error;
  fs::create_directories(options.model_folder, error);
  if (error) throw Error(options.model_folder.string(), ": cannot create: ", error.message());
  fs::remove(options.model_folder / "basis.npy",
             error);  // an old basis must never be beside a new mean
  BasisWriter basis(options.model_folder / "basis.npy", rank, d);
  std::vector<float> mean(d), values;
  Panel panel;
  for (int64_t first = 0; first < d; first += width) {
    check_stop(options);
    panel.load(features, fitted, m, first, std::min(width, d - first), options.threads);
    std::copy(panel.mean.begin(), panel.mean.end(), mean.begin() + first);
    values.resize(rank * panel.width);
    constexpr int64_t kColumns = 1024;  // per product V^T = (L^(-1/2) U^T) F
    parallel_ranges(panel.width, kColumns, options.threads, [&](int64_t begin, int64_t end) {
      multiply(rank, end - begin, m, weights.data(), m, panel.values.data() + begin, panel.width,
               values.data() + begin, panel.width);
    });
    basis.write(first, panel.width, values.data());
    if (options.progress) options.progress(first + panel.width, d);
  }
  proto::write_npy(options.model_folder / "mean.npy", {d}, mean.data());
  basis.finish();
}

}  // namespace revisit
