#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "revisit/datasets/dataset_features.h"
#include "revisit/evaluation/protocols.h"
#include "revisit/recognition/comparison.h"
#include "revisit/recognition/matrix.h"

namespace revisit::pipeline {

struct ReductionOptions {
  int64_t components = -1;  // of the PCA; 0: as many as the data gives; -1: no PCA
  /// Scans of a PCA or a ring mean: all, the stored ones ("map"), or a folder with a PCA.
  std::string fit_on = "all";
  double memory_gb = 2;  // of the PCA; without one, bounds the descriptors
  int threads = 1;       // the values do not depend on it
};

/// Descriptors of all scans, in alignment case 1 and, when asked for, in case 2.
struct Descriptors {
  FloatMatrix case1;
  std::optional<FloatMatrix> case2;
  Comparison comparison;
  std::string pca_fit;  // what the PCA learnt from, for people
  std::string note;     // when fewer components were kept than asked
  /// Descriptors [n][d] of more features by the same basis; empty for a PCA that was not written.
  std::function<FloatMatrix(const FeatureFile& features)> of_more;
};
/// Throws Error naming the scan (the row) and the alignment case of a number that is not finite.
void check_finite(const Descriptors& descriptors);

/// Without PCA, the descriptors are the features. `case2` may be null; `model_folder`, when not
/// empty, gets the PCA model. Throws what fit_pca() and PcaModel throw, UsageError when the memory
/// cannot hold them, Error for a descriptor that is not finite.
Descriptors reduce(const ReductionOptions& options, const Task& task, DatasetFeatures& case1,
                   DatasetFeatures* case2, const Observer& observer,
                   const std::filesystem::path& model_folder = {});

/// Descriptors for one task after another; those of equal scans are reused. A `cache` folder keeps
/// them without features: descriptors of all components serve any smaller number.
class TaskDescriptors {
 public:
  /// `case2` may be null, `cache` empty. The features and the observer are referred to.
  TaskDescriptors(ReductionOptions options, DatasetFeatures& case1, DatasetFeatures* case2,
                  std::filesystem::path cache, const Observer& observer);

  /// Rows of the scans that could not be described; they are described now if they were not yet.
  std::vector<int64_t> left_out() const;

  /// Valid until the next call. The task neither stores nor asks left_out().
  const Descriptors& of(const Task& task);

 private:
  std::optional<Descriptors> cached(const Task& task) const;
  Descriptors compute(const Task& task) const;

  ReductionOptions options_;
  DatasetFeatures& case1_;
  DatasetFeatures* case2_;
  std::filesystem::path cache_;  // empty: nothing is kept
  const Observer& observer_;
  std::string key_;
  Descriptors last_;
};

}  // namespace revisit::pipeline
