#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "feature_options.h"
#include "reports.pb.h"
#include "revisit/pipeline/precision_recall.h"

namespace revisit::cli {

/// Everything one task gave.
struct TaskResult {
  pipeline::Task task;
  pipeline::TrueMatchRule rule;
  std::vector<pipeline::Match> matches;     // as task.queries
  std::vector<pipeline::Verdict> verdicts;  // as task.queries
  std::vector<pipeline::PrPoint> curve;
  pipeline::PrSummary summary;
  std::string pca_fit;
};

/// What the files of a run are made from.
struct RunContext {
  const FeatureOptions& options;
  const pipeline::Dataset& dataset;
  const pipeline::Trajectory& trajectory;
  const FeatureSource& source;
  const std::vector<pipeline::AlignmentRecord>& alignments;  // of each scan, as taken
  std::vector<std::pair<std::string, std::string>>
      settings;  // option names and values, for config.yaml
  int k = 4;
};

/// Makes `<output>/<dataset>_<sequence>/<time>/` and returns it. Throws Error.
std::filesystem::path make_run_folder(const std::filesystem::path& output,
                                      const pipeline::Dataset& dataset);

/// Points the `latest` link beside the run folder to it.
void link_latest(const std::filesystem::path& run);

/// The files of DESIGN section 5: config.yaml, run.json, loops_<task>.csv, pr_<task>.csv,
/// metrics.json.
void write_run(const std::filesystem::path& run, const RunContext& context,
               const std::vector<TaskResult>& results, const pipeline::DescribeTimes& times);

/// What metrics.json holds.
reports::MetricsList metrics_list(const std::vector<TaskResult>& results);

/// Heading of the query minus heading of its match, counter-clockwise [deg] in (-180, 180], as the
/// alignments tell it: both clouds were turned to the principal directions of one place.
double relative_yaw_deg(const pipeline::Match& match,
                        const std::vector<pipeline::AlignmentRecord>& alignments);

}  // namespace revisit::cli
