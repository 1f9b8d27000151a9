#pragma once

#include <filesystem>
#include <iosfwd>
#include <optional>
#include <string>
#include <vector>

#include "eval/eval_options.h"
#include "reports.pb.h"

namespace revisit::cli {

/// Maximum per query with range images.
inline constexpr int kShownMatches = 4;

struct RunContext {
  const EvalOptions& given;
  const Dataset& dataset;
  const Trajectory& trajectory;
  const FeatureSource& source;
  const EvaluationResult& result;  // an alignment per scan
  std::string key;                 // EvaluationKey::text
};

/// Latest finished run below `output` whose run.json has this key, or "".
std::filesystem::path finished_run(const std::filesystem::path& output, const std::string& key);

/// Table of all scans: poses, alignments, and the tasks that store them.
void write_scans(const std::filesystem::path& file, const RunContext& context);

/// Creates `<output>/<dataset>_<sequence>/<time>/` with tables for people, and run.json last,
/// because it marks the run complete. Points the link `latest` beside it to it; warns if another
/// file has that name. Returns the folder. Throws Error.
std::filesystem::path write_run(const RunContext& context);

/// Content of run.json.
reports::Run run_of(const RunContext& context);

/// A task without NaN; `pose_source` names the ground truth, e.g. a poses file.
reports::Metrics metrics_report(const PrSummary& summary, const Task& task,
                                const std::string& pose_source);
reports::Metrics metrics_of(const TaskResult& result, int resamples);

/// Intervals that were not computed stay empty.
void add_intervals(reports::Metrics& metrics, const PrIntervals& intervals, int resamples,
                   int64_t n_blocks);

/// At most a few hundred points for drawing, with the first and the last; none without positives.
reports::Curve drawn_curve(const std::vector<PrPoint>& curve);

/// Scans per second of CPU time of one thread, from points to feature, as the paper measures.
std::optional<double> frames_per_second(const DescribeTimes& times);

void print_times(const EvaluationResult& result, std::ostream& out);

}  // namespace revisit::cli
