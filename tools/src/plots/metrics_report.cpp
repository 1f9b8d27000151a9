#include "plots/metrics_report.h"

#include <cmath>

namespace revisit::cli {

reports::Metrics metrics_report(const pipeline::PrSummary& summary, const pipeline::Task& task,
                                const pipeline::TrueMatchRule& rule,
                                const std::string& pose_source) {
  reports::Metrics metrics;
  metrics.set_protocol(task.name);
  metrics.set_definition(task.definition);
  metrics.set_population(task.population);
  metrics.set_decision(task.decision == pipeline::Decision::kPair ? "pair" : "query");
  metrics.set_radius_m(rule.radius);
  if (rule.false_beyond > rule.radius) metrics.set_false_beyond_m(rule.false_beyond);
  metrics.set_distance(pipeline::name_of(rule.distance));
  metrics.set_exclusion(pipeline::to_string(task.exclusion));
  metrics.set_pose_source(pose_source);
  metrics.set_n_queries(static_cast<int>(summary.n_queries));
  metrics.set_n_positives(static_cast<int>(summary.n_positives));
  if (task.decision == pipeline::Decision::kPair) {
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

void add_intervals(reports::Metrics& metrics, const pipeline::PrIntervals& intervals,
                   int resamples) {
  metrics.set_bootstrap_resamples(resamples);
  const auto add = [&](void (reports::Metrics::*adder)(double),
                       const pipeline::Interval& interval) {
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
