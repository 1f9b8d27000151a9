#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "feature_options.h"
#include "reports.pb.h"
#include "revisit/evaluation/bootstrap.h"
#include "revisit/evaluation/pairs.h"
#include "revisit/evaluation/precision_recall.h"
#include "run_times.h"

namespace revisit::cli {

/// Everything one task gave.
struct TaskResult {
  pipeline::Task task;
  pipeline::TrueMatchRule rule;
  pipeline::Score score = pipeline::Score::kMargin;
  std::vector<pipeline::Match> matches;     // as task.queries; none when pairs are decided
  std::vector<pipeline::Verdict> verdicts;  // as task.queries; none when pairs are decided
  std::vector<pipeline::PrPoint> curve;
  pipeline::PrSummary summary;
  std::optional<pipeline::PrIntervals> intervals;     // absent: not asked for
  std::optional<pipeline::ScoreHistogram> histogram;  // when pairs are decided
  std::string query_case;                             // as in reports.proto
  std::string pca_fit;
  int64_t descriptor_dim = 0;  // after the reduction
  int64_t n_left_out = 0;      // scans that could not be described: neither stored nor asked

  bool on_pairs() const { return task.decision == pipeline::Decision::kPair; }
  /// Of each query: its score reaches the threshold of the best F1. All false when there is none.
  std::vector<bool> accepted() const;
};

/// What the files of a run are made from.
struct RunContext {
  const FeatureOptions& options;
  const pipeline::Dataset& dataset;
  const pipeline::Trajectory& trajectory;
  const FeatureSource& source;
  const std::vector<pipeline::AlignmentRecord>& alignments;  // of each scan, as taken
  std::vector<std::pair<std::string, std::string>>
      settings;         // option names and values, for config.yaml
  std::string command;  // that repeats the run
  int resamples = 0;    // of the bootstrap; 0: none
};

/// Makes `<output>/<dataset>_<sequence>/<time>/` and returns it. Throws Error.
std::filesystem::path make_run_folder(const std::filesystem::path& output,
                                      const pipeline::Dataset& dataset);

/// Points the `latest` link beside the run folder to it. Warns where a file or folder has that
/// name.
void link_latest(const std::filesystem::path& run);

/// config.yaml, run.json, scans.csv (where each scan was taken, how it was aligned and which tasks
/// store it), pr_<task>.csv, loops_<task>.csv (not when pairs are decided), report.json (all of it
/// again, for the page) and metrics.json, which comes last: with it the run is complete.
void write_run(const std::filesystem::path& run, const RunContext& context,
               const std::vector<TaskResult>& results, const RunTimes& times);

/// What metrics.json holds.
reports::MetricsList metrics_list(const std::vector<TaskResult>& results, int resamples);

/// Heading of the query minus heading of its match, counter-clockwise [deg] in (-180, 180], as the
/// alignments tell it: both clouds were turned to the principal directions of one place.
double relative_yaw_deg(const pipeline::Match& match,
                        const std::vector<pipeline::AlignmentRecord>& alignments);

}  // namespace revisit::cli
