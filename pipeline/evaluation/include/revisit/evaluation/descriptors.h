#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "revisit/datasets/describe.h"
#include "revisit/evaluation/protocols.h"
#include "revisit/recognition/match.h"
#include "revisit/recognition/matrix.h"
#include "revisit/recognition/place_index.h"

namespace revisit {

/// How features become descriptors.
struct ReductionOptions {
  int64_t components = -1;  ///< of the PCA; 0: as many as the data has; -1: no PCA
  /// Scans for the PCA or the ring mean: "all", the stored ones ("map"), or a folder with a PCA.
  std::string fit_on = "all";
  double memory_gb = 2;  ///< working memory of the PCA; without PCA the limit for the descriptors
  int threads = 1;       ///< does not affect the result
};

/// Rows are all scans.
struct Descriptors {
  FloatMatrix case1;                 ///< [scans][d], alignment case 1 or as stored
  std::optional<FloatMatrix> case2;  ///< [scans][d], if needed
  Comparison comparison;             ///< similarity of two descriptors
  std::string pca_fit;               ///< source of the PCA, for display
  std::string note;                  ///< if fewer components were kept than requested
  /// Descriptors [n][d] of more features; empty for a PCA that was not written.
  std::function<FloatMatrix(const FeatureFile& features)> of_more;
};
/// Throws Error with the scan (row) and the alignment case if a value is not finite.
void check_finite(const Descriptors& descriptors);

/// Computes descriptors from features; without PCA they are equal. `case2` may be null. The PCA
/// model is written to `model_folder` unless it is empty. Throws what fit_pca() and PcaModel throw,
/// UsageError if the memory limit is too small, and Error if a descriptor is not finite.
Descriptors reduce(const ReductionOptions& options, const Task& task, DatasetFeatures& case1,
                   DatasetFeatures* case2, const Observer& observer,
                   const std::filesystem::path& model_folder = {});

/// As reduce(), kept in the folder `cache` (empty: not kept), from which features are not needed.
Descriptors cached_or_reduced(const ReductionOptions& options, const Task& task,
                              DatasetFeatures& case1, DatasetFeatures* case2,
                              const Observer& observer, const std::filesystem::path& cache);

/// Rows of scans that cannot be described in one of the cases. Describes the scans first if
/// necessary.
std::vector<int64_t> skipped_rows(DatasetFeatures& case1, DatasetFeatures* case2);

/// Alignment cases in which queries are described; stored scans always use case 1.
enum class QueryCase { kAsStored, kTwo, kBoth };

/// Retrieves the k most similar stored scans for every query of `task`. With both cases the higher
/// score wins, case 1 on a tie. Candidates that compact codes exclude have similarity -1.
///
/// Throws UsageError for k or threads < 1, Error if shapes do not match or a descriptor or
/// similarity is not finite, and Interrupted.
std::vector<Match> retrieve(const Descriptors& descriptors, const Task& task,
                            const SearchOptions& options = {},
                            QueryCase query_case = QueryCase::kAsStored);

}  // namespace revisit
