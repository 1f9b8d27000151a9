#include "eval/run_data.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "eval/curve.h"

namespace revisit::cli {
namespace {

void add_scans(const RunContext& context, reports::Run& run) {
  for (const ScanRef& scan : context.dataset.scans) {
    run.add_file(std::filesystem::absolute(scan.file).string());
    run.add_frame(scan.frame);
  }
  for (const Eigen::Vector3d& position : context.trajectory.positions) {
    run.add_x(rounded(position.x(), 0.01));
    run.add_z(rounded(position.z(), 0.01));
  }
  const auto aligned = [](const AlignmentRecord& a) { return !std::isnan(a.yaw); };
  if (std::ranges::none_of(context.alignments, aligned)) return;  // camera images
  for (size_t i = 0; i < context.alignments.size(); ++i) {
    const AlignmentRecord& a = context.alignments[i];
    run.add_yaw_deg(rounded(a.yaw * 180 / std::numbers::pi, 0.1));
    run.add_eigenvalue_ratio(rounded(a.eigenvalue_ratio, 1e-3));
    run.add_abs_t11(rounded(a.abs_t11, 1e-3));
    if (a.mirrored_choice > 0) run.add_mirrored(static_cast<int>(i));
  }
}

void add_queries(const TaskResult& result, reports::RunTask& task) {
  size_t matches_per_query = 1;
  for (const Match& match : result.matches)
    matches_per_query = std::clamp(match.ranks.size(), matches_per_query, size_t{kShownMatches});
  const std::vector<bool> accepted = result.accepted();
  for (size_t q = 0; q < result.matches.size(); ++q) {
    const Match& match = result.matches[q];
    const MatchLabel& verdict = result.labels[q];
    task.add_scan(static_cast<int>(match.query));
    for (size_t i = 0; i < matches_per_query; ++i) {
      const bool there = i < match.ranks.size();
      task.add_match(there ? static_cast<int>(match.ranks[i]) : -1);
      task.add_similarity(there ? rounded(match.similarities[i], 1e-5) : 0);
    }
    task.add_score(rounded(match.score, 1e-5));
    task.add_flags(accepted[q] + 2 * verdict.correct + 4 * verdict.positive + 8 * verdict.ignored +
                   16 * (match.which_case == 2));
  }
}

reports::RunTask run_task(const TaskResult& result, const reports::Metrics& metrics) {
  reports::RunTask task;
  *task.mutable_metrics() = metrics;
  *task.mutable_curve() = drawn_curve(result.curve);
  for (const int64_t scan : result.task.stored) task.add_stored(static_cast<int>(scan));
  add_queries(result, task);
  if (result.histogram) {
    reports::Histogram& histogram = *task.mutable_histogram();
    histogram.set_low(result.histogram->low);
    histogram.set_width(result.histogram->width);
    for (const int64_t count : result.histogram->of_true)
      histogram.add_of_true(static_cast<double>(count));
    for (const int64_t count : result.histogram->of_false)
      histogram.add_of_false(static_cast<double>(count));
  }
  return task;
}

}  // namespace

reports::Run run_data(const RunContext& context, const std::vector<TaskResult>& results,
                      const reports::RunInfo& info, const reports::MetricsList& metrics) {
  reports::Run run;
  *run.mutable_info() = info;
  for (const auto& [name, value] : context.settings) {
    if (value.empty()) continue;
    reports::Setting& setting = *run.add_configuration();
    setting.set_name(name);
    setting.set_value(value);
  }
  add_scans(context, run);
  for (size_t i = 0; i < results.size(); ++i)
    *run.add_tasks() = run_task(results[i], metrics.tasks(static_cast<int>(i)));
  return run;
}

reports::Metrics metrics_report(const PrSummary& summary, const Task& task,
                                const std::string& pose_source) {
  reports::Metrics metrics;
  metrics.set_protocol(task.name);
  metrics.set_definition(task.definition);
  metrics.set_population(task.population);
  metrics.set_decision(task.decision == Decision::kPair ? "pair" : "query");
  const TrueMatchRule& rule = task.rule;
  if (rule.distance != Distance::kPairs) metrics.set_radius_m(rule.radius);
  if (rule.false_beyond > rule.radius) metrics.set_false_beyond_m(rule.false_beyond);
  metrics.set_distance(name_of(rule.distance));
  metrics.set_exclusion(to_string(task.exclusion));
  metrics.set_pose_source(pose_source);
  metrics.set_n_queries(static_cast<int>(summary.n_queries));
  metrics.set_n_positives(static_cast<int>(summary.n_positives));
  if (task.decision == Decision::kPair) {
    metrics.set_n_pairs(static_cast<int>(summary.n_pairs));
    metrics.set_n_true_pairs(static_cast<int>(summary.n_true_pairs));
  }
  const auto set = [&](void (reports::Metrics::*setter)(double), double value) {
    if (!std::isnan(value)) (metrics.*setter)(value);
  };
  set(&reports::Metrics::set_f1_max, summary.f1_max);
  set(&reports::Metrics::set_average_precision, summary.average_precision);
  set(&reports::Metrics::set_recall_at_1, summary.recall_at_1);
  set(&reports::Metrics::set_max_recall_at_precision_1, summary.max_recall_at_precision_1);
  set(&reports::Metrics::set_extended_precision, summary.extended_precision);
  set(&reports::Metrics::set_f1_max_threshold, summary.f1_max_threshold);
  return metrics;
}

void add_intervals(reports::Metrics& metrics, const PrIntervals& intervals, int resamples,
                   int64_t n_blocks) {
  metrics.set_bootstrap_resamples(resamples);
  metrics.set_bootstrap_blocks(static_cast<int>(n_blocks));
  const auto add = [&](void (reports::Metrics::*adder)(double), const Interval& interval) {
    if (std::isnan(interval.low)) return;
    (metrics.*adder)(interval.low);
    (metrics.*adder)(interval.high);
  };
  add(&reports::Metrics::add_f1_max_ci, intervals.f1_max);
  add(&reports::Metrics::add_average_precision_ci, intervals.average_precision);
  add(&reports::Metrics::add_recall_at_1_ci, intervals.recall_at_1);
  add(&reports::Metrics::add_max_recall_at_precision_1_ci, intervals.max_recall_at_precision_1);
  add(&reports::Metrics::add_extended_precision_ci, intervals.extended_precision);
}

}  // namespace revisit::cli
