#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "revisit/recognition/feature_file.h"
#include "revisit/recognition/matrix.h"

namespace revisit {

/// Files of one dimension; rows count through all. A second file may hold alignment case 2.
using FeatureFiles = std::vector<const FeatureFile*>;

struct PcaOptions {
  int64_t components = 400;
  /// Rows that mean and directions are estimated from, e.g. the map's scans; empty: all.
  std::vector<int64_t> fit_rows;
  /// [bytes] upper bound of the working memory, without the result.
  int64_t memory = int64_t{2} << 30;
  int threads = 1;  // the result is bitwise the same for any number
  /// If set, the model is also written to this folder, in a second pass over the files.
  std::filesystem::path model_folder;
  std::function<void(int64_t done, int64_t total)> progress;  // [columns read]
  std::function<bool()> stop;                                 // true: throw Interrupted
};

struct PcaResult {
  FloatMatrix descriptors;  // [n][rank], neither whitened nor normalized
  int64_t rank = 0;         // components kept: at most options.components, fitted rows - 1 and d
  std::vector<double> variances;  // [rank], over the m fitted rows (divisor m - 1)
  double total_variance = 0;      // centered features; variances / total = explained
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
///   FeatureFile case1("features.npy");
///   PcaResult pca = fit_pca({&case1}, {.components = 400, .fit_rows = task.stored});
///
/// Throws UsageError if components or threads < 1, if the memory bound cannot hold the Gram matrix
/// (the message has the required size), if a fit row does not exist or is repeated, or if fewer
/// than 2 rows are fitted. Throws InputError if the files do not match or a value is not finite;
/// Interrupted.
PcaResult fit_pca(const FeatureFiles& files, const PcaOptions& options = {});

inline constexpr double kRankTolerance = 1e-6;

/// Folder with `mean.npy` [d] and `basis.npy` [k][d] (orthonormal rows).
class PcaModel {
 public:
  /// Throws InputError for missing or mismatched files or a NaN mean; project() checks the basis.
  explicit PcaModel(const std::filesystem::path& folder);
  int64_t components() const { return basis_.n(); }
  int64_t dim() const { return basis_.d(); }
  /// Computes descriptors [n][k] = (x - mean) basis^T of all rows. Of `options` it uses components
  /// (at most those of the model; fewer keep the first ones), memory, threads, progress and stop.
  /// Throws InputError if the features have another dimension or are not finite; Interrupted.
  FloatMatrix project(const FeatureFiles& files, const PcaOptions& options = {}) const;
  /// Projects one feature [dim()] to as many components as `descriptor` has elements.
  void project(std::span<const float> feature, std::span<float> descriptor) const;

 private:
  std::filesystem::path folder_;
  std::vector<float> mean_;  // [d]
  FeatureFile basis_;        // [k][d]
};

}  // namespace revisit
