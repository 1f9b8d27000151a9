#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "eval/eval_options.h"
#include "eval/run_folder.h"

namespace revisit::cli {

/// What an evaluation gave; the rest is in its folder.
struct Evaluation {
  std::filesystem::path run;
  std::vector<TaskResult> tasks;
  pipeline::Trajectory trajectory;
  RunTimes times;
  std::string feature, similarity;    // their names
  int64_t feature_dim = 0;            // before the reduction
  bool reduced = true;                // by PCA
  bool trained = true;                // false: a network of random weights
  std::vector<std::string> left_out;  // names of the scans that could not be described
};

/// What an evaluation is made from.
struct EvaluationKey {
  std::string text;               // names everything that the results depend on
  std::filesystem::path feature;  // the file of its features, which others may share
  /// The large files of the cache; not needed once the descriptors are there, too.
  std::vector<std::filesystem::path> large_files;
};

/// Opens the data set and the feature, but describes nothing (FAB-MAP learns its words). Throws
/// what evaluate() would.
EvaluationKey evaluation_key(const EvalOptions& options);

/// Describes every scan, retrieves, judges, and writes the folder of the run. What an earlier call
/// left in the cache is not computed again. Throws Interrupted: the cache keeps what was done.
Evaluation evaluate(const EvalOptions& options);

}  // namespace revisit::cli
