#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "eval/eval_options.h"

namespace revisit::cli {

struct FinishedEvaluation {
  std::filesystem::path run;
  EvaluationResult result;
  Trajectory trajectory;
  FeatureSource source;
  std::vector<std::string> skipped;  // names of scans
};

struct EvaluationKey {
  std::string text;               // everything that the results depend on
  std::filesystem::path feature;  // file of the features, which other runs may share
  /// Large files of the cache with their key files; not needed once the descriptors are cached.
  std::vector<std::filesystem::path> large_files;
};

/// Describes nothing, but FAB-MAP trains its vocabulary. Throws what evaluate() throws.
EvaluationKey evaluation_key(const EvalOptions& options);

/// Writes the folder of the run. Throws what Evaluation throws.
FinishedEvaluation evaluate(const EvalOptions& options);

/// `--ground-truth`: writes the correct pairs of each scan with earlier ones beyond the exclusion.
/// Returns their number, for display. Throws what find_loops() throws.
std::string write_ground_truth(const EvalOptions& options);

struct DescribedScans {
  std::string feature, pca_fit;
  int64_t n = 0, feature_dim = 0;
  std::vector<std::string> skipped;  // names of scans
  EvaluationResult result;           // with times only
};
/// `--descriptors`. Throws what describing and reducing throw.
DescribedScans write_descriptors(const EvalOptions& options);

}  // namespace revisit::cli
