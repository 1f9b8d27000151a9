#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "eval/eval_options.h"
#include "revisit/evaluation/evaluate.h"

namespace revisit::cli {

struct FinishedEvaluation {
  std::filesystem::path run;
  EvaluationResult result;
  Trajectory trajectory;
  std::string feature, similarity;
  int64_t feature_dim = 0;           // before the reduction
  bool reduced = true;               // by PCA
  bool trained = true;               // false: random weights
  std::vector<std::string> skipped;  // names of scans
};

struct EvaluationKey {
  std::string text;               // everything that the results depend on
  std::filesystem::path feature;  // file of the features, which other runs may share
  int64_t feature_dim = 0;        // before the reduction
  /// Large files of the cache with their key files; not needed once the descriptors are cached.
  std::vector<std::filesystem::path> large_files;
};

/// Describes nothing, but FAB-MAP trains its vocabulary. Throws what evaluate() throws.
EvaluationKey evaluation_key(const EvalOptions& options);

/// Writes the folder of the run. Throws what Evaluation throws.
FinishedEvaluation evaluate(const EvalOptions& options);

}  // namespace revisit::cli
