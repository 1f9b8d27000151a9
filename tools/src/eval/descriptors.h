#pragma once

#include <optional>

#include "feature_options.h"
#include "revisit/pipeline/pca.h"
#include "revisit/pipeline/protocols.h"

namespace revisit::cli {

/// Descriptors of all scans, in alignment case 1 and, for tasks that ask for it, in case 2.
struct Descriptors {
  pipeline::FloatMatrix case1;
  std::optional<pipeline::FloatMatrix> case2;
  std::string pca_fit;  // what the PCA learnt from, for people; "none" without one
  std::string note;     // when fewer components were kept than asked
};

/// Reduces the features of one task by PCA to `components` (see FeatureSource) as `options.pca_fit`
/// says: learnt from all scans, from the stored ones ("map"), or read from a folder. Without PCA
/// the features are the descriptors; `options.memory_gb` bounds them. `case2` may be null.
/// `model_folder`, when not empty, gets the PCA model.
Descriptors reduce(const FeatureOptions& options, int64_t components, const pipeline::Task& task,
                   const Features& case1, const Features* case2,
                   const std::filesystem::path& model_folder = {});

}  // namespace revisit::cli
