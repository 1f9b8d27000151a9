#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "revisit/evaluation/descriptors.h"

namespace revisit {

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
