#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "eval/eval_options.h"
#include "revisit/evaluation/evaluate.h"

namespace revisit::cli {

/// What `revisit eval` found; the rest is in the folder of the run.
struct FinishedEvaluation {
  std::filesystem::path run;
  pipeline::EvaluationResult result;
  pipeline::Trajectory trajectory;
  std::string feature, similarity;    // their names
  int64_t feature_dim = 0;            // before the reduction
  bool reduced = true;                // by PCA
  bool trained = true;                // false: a network of random weights
  std::vector<std::string> left_out;  // names of the scans that could not be described
};

struct EvaluationKey {
  std::string text;               // names everything that the results depend on
  std::filesystem::path feature;  // the file of its features, which others may share
  int64_t feature_dim = 0;        // before the reduction
  /// The large files of the cache, with their keys; not needed once the descriptors are there, too.
  std::vector<std::filesystem::path> large_files;
};

/// Opens data and feature without describing (FAB-MAP learns its words). Throws as evaluate().
EvaluationKey evaluation_key(const EvalOptions& options);

/// Evaluates, and writes the folder of the run. Throws what pipeline::Evaluation throws.
FinishedEvaluation evaluate(const EvalOptions& options);

}  // namespace revisit::cli
