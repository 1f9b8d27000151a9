#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "revisit/recognition/feature_file.h"
#include "revisit/recognition/matrix.h"

namespace revisit::pipeline {

/// Features of one dimension, rows counted through all files: a second one may be alignment case 2.
using FeatureFiles = std::vector<const FeatureFile*>;

struct PcaOptions {
  int64_t components = 400;
  /// Rows the mean and the directions are learnt from (e.g. the map's scans); empty: all rows.
  std::vector<int64_t> fit_rows;
  /// Upper bound for the working memory [bytes], without the result.
  int64_t memory = int64_t{2} << 30;
  int threads = 1;  // the result does not depend on it, bit for bit
  /// When set: also write the model to this folder (a second pass over the files).
  std::filesystem::path model_folder;
  std::function<void(int64_t done, int64_t total)> progress;  // in columns read
  std::function<bool()> stop;                                 // true: throw Interrupted
};

struct PcaResult {
  FloatMatrix descriptors;        // [n][rank], not whitened, not normalised
  int64_t rank = 0;               // components kept: at most the asked, the rows fitted - 1 and d
  std::vector<double> variances;  // [rank], of each component over the fitted rows (divisor m - 1)
  double total_variance = 0;      // of the centred features; variances / total = explained
  /// For people, when fewer components were kept than asked; else "".
  std::string note;
};

/// Principal components of features far wider than there are scans, without a d-sized matrix.
///
/// With X [n][d] centred on the mean of the m fitted rows F, the m x m Gram matrix G = F F^T has
/// the nonzero eigenvalues of the scatter matrix F^T F: G U = U L. The directions are V = F^T U
/// L^(-1/2) and so the descriptors X V = (X F^T) U L^(-1/2): only X F^T [n][m] is needed, summed
/// over panels of columns. Sums within a panel (8192 columns) are in float, across them in double.
/// Components below kRankTolerance of the largest eigenvalue are dropped: float sums cannot tell
/// them from zero. The entry of largest magnitude in each column of U is positive.
///
///   FeatureFile case1("features.npy");
///   PcaResult pca = fit_pca({&case1}, {.components = 400, .fit_rows = task.stored});
///
/// Throws UsageError when components or threads < 1, the memory bound cannot hold the Gram matrix
/// (saying how much would do), a fit row does not exist or is given twice, or fewer than 2 rows are
/// fitted; InputError when the files do not fit together or hold a value that is not finite;
/// Interrupted.
PcaResult fit_pca(const FeatureFiles& files, const PcaOptions& options = {});

inline constexpr double kRankTolerance = 1e-6;

/// A PCA learnt earlier: a folder with `mean.npy` [d] and `basis.npy` [k][d] (orthonormal rows).
class PcaModel {
 public:
  /// Throws InputError for missing or misfit files, or NaN in the mean; project() checks the basis.
  explicit PcaModel(const std::filesystem::path& folder);
  int64_t components() const { return basis_.n(); }
  int64_t dim() const { return basis_.d(); }
  /// Descriptors [n][k] = (x - mean) basis^T of all rows. Of `options` uses components (at most
  /// what the model has; fewer keeps the first), memory, threads, progress and stop.
  ///
  ///   PcaModel model("results/00/pca");
  ///   FloatMatrix descriptors = model.project({&case1, &case2});
  ///
  /// Throws InputError when the features have another dimension or are not finite; Interrupted.
  FloatMatrix project(const FeatureFiles& files, const PcaOptions& options = {}) const;
  /// The same of one feature [dim()]: as many components as `descriptor` takes.
  void project(std::span<const float> feature, std::span<float> descriptor) const;

 private:
  std::filesystem::path folder_;
  std::vector<float> mean_;  // [d]
  FeatureFile basis_;        // [k][d]
};

}  // namespace revisit::pipeline
