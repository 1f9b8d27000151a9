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

namespace revisit {

struct ReductionOptions {
  int64_t components = -1;  // of the PCA; 0: as many as the data has; -1: no PCA
  /// Scans for the PCA or the ring mean: "all", the stored ones ("map"), or a folder with a PCA.
  std::string fit_on = "all";
  double memory_gb = 2;  // working memory of the PCA; without PCA the limit for the descriptors
  int threads = 1;       // does not affect the result
};

/// Rows are all scans.
struct Descriptors {
  FloatMatrix case1;
  std::optional<FloatMatrix> case2;
  Comparison comparison;
  std::string pca_fit;  // source of the PCA, for display
  std::string note;     // if fewer components were kept than requested
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

/// Computes descriptors for a sequence of tasks and reuses those of equal scans. A `cache` folder
/// stores them without features; descriptors with all components serve any smaller number.
class TaskDescriptors {
 public:
  /// `case2` may be null, `cache` empty. Keeps references to the features and the observer.
  TaskDescriptors(ReductionOptions options, DatasetFeatures& case1, DatasetFeatures* case2,
                  std::filesystem::path cache, const Observer& observer);

  /// Rows. Describes the scans first if necessary.
  std::vector<int64_t> skipped() const;

  /// Valid until the next call. The task must not store or query rows in skipped().
  const Descriptors& of(const Task& task);

 private:
  std::optional<Descriptors> cached(const Task& task) const;
  Descriptors compute(const Task& task) const;

  ReductionOptions options_;
  DatasetFeatures& case1_;
  DatasetFeatures* case2_;
  std::filesystem::path cache_;
  const Observer& observer_;
  std::string key_;
  Descriptors last_;
};

}  // namespace revisit
