#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "feature_options.h"
#include "reports.pb.h"
#include "revisit/evaluation/evaluate.h"

namespace revisit::cli {

struct RunContext {
  const FeatureOptions& options;
  const Dataset& dataset;
  const Trajectory& trajectory;
  const FeatureSource& source;
  const std::vector<AlignmentRecord>& alignments;  // one per scan
  std::vector<std::pair<std::string, std::string>> settings;
  std::string command;
  std::string key;    // EvaluationKey::text
  int resamples = 0;  // bootstrap; 0: none
};

/// Creates `<output>/<dataset>_<sequence>/<time>/` and returns it. Throws Error.
std::filesystem::path make_run_folder(const std::filesystem::path& output, const Dataset& dataset);

/// Points the link `latest` beside the run folder to it. Warns if a file or folder has that name.
void link_latest(const std::filesystem::path& run);

/// Latest finished run below `output` whose run.json has this key, or "".
std::filesystem::path finished_run(const std::filesystem::path& output, const std::string& key);

/// Writes metrics.json last, because it marks the run complete. Tasks on pairs have no loops_*.csv.
void write_run(const std::filesystem::path& run, const RunContext& context,
               const std::vector<TaskResult>& results, const EvaluationTimes& times);

/// Content of metrics.json.
reports::MetricsList metrics_list(const std::vector<TaskResult>& results, int resamples);

}  // namespace revisit::cli
