#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "revisit/recognition/matrix.h"

namespace revisit {

/// Streams features to a file of float32 rows, and resumes after an interruption.
///
/// A row is a feature of `dim` floats and `extra` floats about it, e.g. its AlignmentRecord. Before
/// finish() the rows are in `FILE.part`, which begins with `key`, a text that identifies everything
/// the features depend on. A part with the same key and shape is resumed; any other part is
/// discarded. If a link or pipe is in its place, an Error is thrown. A finished file ends with a
/// checksum.
///
///   if (!features_complete(file, key)) {
///     FeatureWriter writer(file, key, n, d);
///     for (int64_t i = writer.rows_written(); i < n; ++i) writer.append(describe(scan[i]));
///     writer.finish();
///   }
///   FeatureFile features(file);
class FeatureWriter {
 public:
  /// Opens or resumes the part. Throws Error if the folder is not writable, the disk has too little
  /// space (with bytes needed and free), or another process writes the same file.
  FeatureWriter(std::filesystem::path file, const std::string& key, int64_t n_rows, int64_t dim,
                int64_t extra = 0);
  ~FeatureWriter();  ///< without finish() the part stays and can be resumed
  FeatureWriter(const FeatureWriter&) = delete;
  FeatureWriter& operator=(const FeatureWriter&) = delete;

  /// Complete rows in the part, so the index of the next row.
  int64_t rows_written() const { return rows_; }
  /// Throws Error if the disk is full (the part stays) or a size is wrong.
  void append(std::span<const float> feature, std::span<const float> extra = {});
  /// Writes the checksum, flushes to disk and renames the part. Throws Error if rows are missing.
  void finish();

 private:
  void continue_or_create();
  int64_t written_bytes() const;
  int64_t missing_bytes() const;
  void check_space() const;
  [[noreturn]] void fail(const std::string& doing) const;

  std::filesystem::path file_, part_;
  std::string header_;
  int64_t n_rows_, dim_, extra_, rows_ = 0;
  uint64_t checksum_ = 0;
  int descriptor_ = -1;
};

/// Returns true if `file` is finished and has this key and a valid checksum. Reads the whole file.
bool features_complete(const std::filesystem::path& file, const std::string& key);

/// Read-only and memory-mapped. Copies share the memory.
class FeatureFile {
 public:
  /// Opens a finished file of FeatureWriter, or a float32 C-order .npy with two axes. Throws
  /// InputError for anything else.
  explicit FeatureFile(std::filesystem::path file);

  int64_t n() const { return n_; }                             ///< number of features
  int64_t d() const { return d_; }                             ///< dimensions of a feature
  const std::filesystem::path& path() const { return file_; }  ///< the mapped file
  /// Feature [d]. Valid while this object lives and the file is not changed.
  std::span<const float> row(int64_t i) const {
    return {data_.get() + i * stride_, static_cast<size_t>(d_)};
  }
  /// Floats about the feature.
  std::span<const float> extra(int64_t i) const {
    return {data_.get() + i * stride_ + d_, static_cast<size_t>(stride_ - d_)};
  }
  /// Features. Refers to this object.
  Rows rows() const {
    return {n_, d_, [this](int64_t i) { return row(i); }};
  }
  /// Copies the first `columns` values of `count` features from feature `first` on, like read().
  FloatMatrix matrix(int64_t first, int64_t count, int64_t columns) const;
  /// Reads `count` floats of row `i` from column `first` on. Unlike row(), the pages do not count
  /// as memory of this process. Throws InputError if the file was truncated.
  void read(int64_t i, int64_t first, int64_t count, float* out) const;

 private:
  friend bool features_complete(const std::filesystem::path& file, const std::string& key);
  void read_header(int64_t size);

  std::filesystem::path file_;
  std::string key_;
  bool is_written_ = false;  ///< by a FeatureWriter: has a key and a checksum
  int64_t n_ = 0, d_ = 0, stride_ = 0, header_bytes_ = 0;
  std::shared_ptr<const int> descriptor_;
  std::shared_ptr<const float> data_;
};

/// Files of one dimension; rows count through all. A second file may hold alignment case 2.
using FeatureFiles = std::vector<const FeatureFile*>;

/// Settings of fit_pca().
struct PcaOptions {
  int64_t components = 400;  ///< maximum number kept
  /// Rows that mean and directions are estimated from, e.g. the map's scans; empty: all.
  std::vector<int64_t> fit_rows;
  /// [bytes] upper bound of the working memory, without the result.
  int64_t memory = int64_t{2} << 30;
  int threads = 1;  ///< the result is bitwise the same for any number
  /// If set, the model is also written to this folder, in a second pass over the files.
  std::filesystem::path model_folder;
  std::function<void(int64_t done, int64_t total)> progress;  ///< [columns read]
  std::function<bool()> stop;                                 ///< true: throw Interrupted
};

/// Descriptors by principal components.
struct PcaResult {
  FloatMatrix descriptors;  ///< [n][rank], neither whitened nor normalized
  int64_t rank = 0;         ///< components kept: at most options.components, fitted rows - 1 and d
  std::vector<double> variances;  ///< [rank], over the m fitted rows (divisor m - 1)
  double total_variance = 0;      ///< centered features; variances / total = explained
  /// Reason if fewer components were kept than requested, else "".
  std::string note;
};

/// PCA of features that have far more dimensions than there are scans, without a d x d matrix.
///
/// Let X [n][d] be centered on the mean of the m fitted rows F. The m x m Gram matrix G = F F^T has
/// the nonzero eigenvalues of the scatter matrix F^T F: G U = U L. The directions are V = F^T U
/// L^(-1/2), so the descriptors are X V = (X F^T) U L^(-1/2). Only X F^T [n][m] is needed; it is
/// summed over panels of 8192 columns, in float within a panel and in double across panels.
/// Components below kRankTolerance of the largest eigenvalue are dropped, because float sums cannot
/// distinguish them from zero. The entry of largest magnitude in each column of U is positive.
///
///   FeatureFile case1("features");
///   PcaResult pca = fit_pca({&case1}, {.components = 400, .fit_rows = task.stored});
///
/// Throws UsageError if components or threads < 1, if the memory bound cannot hold the Gram matrix
/// (the message has the required size), if a fit row does not exist or is repeated, or if fewer
/// than 2 rows are fitted. Throws InputError if the files do not match or a value is not finite;
/// Interrupted.
PcaResult fit_pca(const FeatureFiles& files, const PcaOptions& options = {});

/// Eigenvalues below this fraction of the largest are dropped.
inline constexpr double kRankTolerance = 1e-6;

/// Folder with `mean.npy` [d] and `basis.npy` [k][d] (orthonormal rows).
class PcaModel {
 public:
  /// Throws InputError for missing or mismatched files or a NaN mean; project() checks the basis.
  explicit PcaModel(const std::filesystem::path& folder);
  int64_t components() const { return basis_.n(); }  ///< k
  int64_t dim() const { return basis_.d(); }         ///< d
  /// Computes descriptors [n][k] = (x - mean) basis^T of all rows. Of `options` it uses components
  /// (at most those of the model; fewer keep the first ones), memory, threads, progress and stop.
  /// Throws InputError if the features have another dimension or are not finite; Interrupted.
  FloatMatrix project(const FeatureFiles& files, const PcaOptions& options = {}) const;
  /// Projects one feature [dim()] to as many components as `descriptor` has elements.
  void project(std::span<const float> feature, std::span<float> descriptor) const;

 private:
  std::filesystem::path folder_;
  std::vector<float> mean_;  ///< [d]
  FeatureFile basis_;        ///< [k][d]
};

}  // namespace revisit
