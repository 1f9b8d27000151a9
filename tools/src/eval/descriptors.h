#pragma once

#include <optional>

#include "eval/lazy_features.h"
#include "revisit/pipeline/pca.h"
#include "revisit/pipeline/protocols.h"

namespace revisit::cli {

/// Descriptors of all scans, in alignment case 1 and, for tasks that ask for it, in case 2.
struct Descriptors {
  pipeline::FloatMatrix case1;
  std::optional<pipeline::FloatMatrix> case2;
  std::string pca_fit;  // what the PCA learnt from, for people
  std::string note;     // when fewer components were kept than asked
};

/// Reduces the features of one task by PCA to `components` (see FeatureSource) as `options.pca_fit`
/// says: learnt from all scans, from the stored ones ("map"), or read from a folder. Without PCA
/// the features are the descriptors; `options.memory_gb` bounds them. `case2` may be null.
/// `model_folder`, when not empty, gets the PCA model.
Descriptors reduce(const FeatureOptions& options, int64_t components, const pipeline::Task& task,
                   LazyFeatures& case1, LazyFeatures* case2,
                   const std::filesystem::path& model_folder = {});

/// The same, taken from `cache` when they are there: then the features are not needed. Descriptors
/// of all components serve any smaller number, as the first components do not depend on how many
/// are asked for. Nothing is kept when `cache` is empty or there is no PCA learnt here.
Descriptors cached_descriptors(const FeatureOptions& options, int64_t components,
                               const pipeline::Task& task, LazyFeatures& case1, LazyFeatures* case2,
                               const std::filesystem::path& cache);

}  // namespace revisit::cli
