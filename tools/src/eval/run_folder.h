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
  const pipeline::Dataset& dataset;
  const pipeline::Trajectory& trajectory;
  const FeatureSource& source;
  const std::vector<pipeline::AlignmentRecord>& alignments;  // one per scan
  std::vector<std::pair<std::string, std::string>>
      settings;         // option names and values, for config.yaml
  std::string command;  // repeats the run
  std::string key;      // EvaluationKey::text
  int resamples = 0;    // bootstrap; 0: none
};

/// Creates `<output>/<dataset>_<sequence>/<time>/` and returns it. Throws Error.
std::filesystem::path make_run_folder(const std::filesystem::path& output,
                                      const pipeline::Dataset& dataset);

/// Points the link `latest` beside the run folder to it. Warns if a file or folder has that name.
void link_latest(const std::filesystem::path& run);

/// Latest finished run below `output` whose run.json has this key, or "".
std::filesystem::path finished_run(const std::filesystem::path& output, const std::string& key);

/// Writes config.yaml, run.json, scans.csv (pose, alignment, tasks that store the scan),
/// pr_<task>.csv, loops_<task>.csv (unless pairs), report.json, and last metrics.json, which marks
/// the run complete.
void write_run(const std::filesystem::path& run, const RunContext& context,
               const std::vector<pipeline::TaskResult>& results,
               const pipeline::EvaluationTimes& times);

/// Content of metrics.json.
reports::MetricsList metrics_list(const std::vector<pipeline::TaskResult>& results, int resamples);

}  // namespace revisit::cli
