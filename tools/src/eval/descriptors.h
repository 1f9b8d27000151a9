#pragma once

#include <optional>

#include "eval/lazy_features.h"
#include "revisit/evaluation/protocols.h"
#include "revisit/recognition/pca.h"

namespace revisit::cli {

/// Descriptors of all scans, in alignment case 1 and, when asked for, in case 2.
struct Descriptors {
  pipeline::FloatMatrix case1;
  std::optional<pipeline::FloatMatrix> case2;
  std::string pca_fit;  // what the PCA learnt from, for people
  std::string note;     // when fewer components were kept than asked
};

/// Reduces the features of one task by PCA to `components` (see FeatureSource) as `options.pca_fit`
/// says: learnt from all scans, from the stored ones ("map"), or read from a folder. Without PCA
/// the features are the descriptors; `options.memory_gb` bounds them. `case2` may be null.
/// `model_folder`, when not empty, gets the PCA model. Throws Error for a descriptor that is not
/// finite.
Descriptors reduce(const FeatureOptions& options, int64_t components, const pipeline::Task& task,
                   LazyFeatures& case1, LazyFeatures* case2,
                   const std::filesystem::path& model_folder = {});

/// The same for one task after another. Those of the last task serve the next when they are learnt
/// from the same scans. With a `cache` folder they are kept there and, when they are there, the
/// features are not needed: descriptors of all components serve any smaller number, as the first
/// components do not depend on how many are asked for.
class TaskDescriptors {
 public:
  /// `case2` may be null, `cache` empty. All is referred to.
  TaskDescriptors(const FeatureOptions& options, int64_t components, LazyFeatures& case1,
                  LazyFeatures* case2, std::filesystem::path cache);

  /// Rows of the scans that could not be described; they are described now if they were not yet.
  std::vector<int64_t> left_out() const;

  /// Valid until the next call. The task neither stores nor asks left_out().
  const Descriptors& of(const pipeline::Task& task);

 private:
  std::optional<Descriptors> cached(const pipeline::Task& task) const;
  Descriptors compute(const pipeline::Task& task) const;

  const FeatureOptions& options_;
  int64_t components_;
  LazyFeatures& case1_;
  LazyFeatures* case2_;
  std::filesystem::path cache_;  // empty: nothing is kept
  std::string key_;
  Descriptors last_;
};

}  // namespace revisit::cli
