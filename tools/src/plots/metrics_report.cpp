#include "plots/metrics_report.h"

#include <cmath>

namespace revisit::cli {

reports::Metrics metrics_report(const pipeline::PrSummary& summary, const pipeline::Task& task,
                                const pipeline::TrueMatchRule& rule,
                                const std::string& pose_source) {
  reports::Metrics metrics;
  metrics.set_protocol(task.name);
  metrics.set_population(task.population);
  metrics.set_radius_m(rule.radius);
  metrics.set_distance(pipeline::name_of(rule.distance));
  metrics.set_exclusion(pipeline::to_string(task.exclusion));
  metrics.set_pose_source(pose_source);
  metrics.set_n_queries(static_cast<int>(summary.n_queries));
  metrics.set_n_positives(static_cast<int>(summary.n_positives));
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

}  // namespace revisit::cli
