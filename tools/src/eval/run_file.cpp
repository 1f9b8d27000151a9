#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <ostream>

#include "cli/terminal.h"
#include "eval/run_folder.h"
#include "revisit/profiling/profile.h"

namespace revisit::cli {
namespace {

constexpr double kCurveStep = 1.0 / 400;  // smaller steps are invisible
constexpr size_t kMaxCurvePoints = 600;

float rounded(double value, double step) {
  return static_cast<float>(std::round(value / step) * step);
}

double sum_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

struct StageTimes {
  const char* name;
  const std::vector<double>& ms;
};

/// Omits stages without times.
std::vector<StageTimes> stages_of(const EvaluationResult& result) {
  const DescribeTimes& d = result.describe_times;
  std::vector<StageTimes> stages;
  for (const StageTimes& stage : {StageTimes{"read", d.read},
                                  {"align", d.align},
                                  {"project", d.project},
                                  {"close", d.close},
                                  {"feature", d.feature},
                                  {"write", d.write},
                                  {"reduce", result.reduce_ms},
                                  {"retrieve", result.retrieve_ms},
                                  {"recognize", result.recognize_ms}})
    if (!stage.ms.empty()) stages.push_back(stage);
  return stages;
}

/// Scans per second of all threads, from files to features; absent without scans.
std::optional<double> scans_per_second(const DescribeTimes& times) {
  if (times.feature.empty() || !(times.wall_ms > 0)) return std::nullopt;
  return 1000 * static_cast<double>(times.feature.size()) / times.wall_ms;
}

void add_scans(const RunContext& context, reports::Run& run) {
  for (const ScanRef& scan : context.dataset.scans) {
    run.add_file(std::filesystem::absolute(scan.file).string());
    run.add_frame(scan.frame);
  }
  for (const Eigen::Vector3d& position : context.trajectory.positions) {
    run.add_x(rounded(position.x(), 0.01));
    const bool z_up = context.trajectory.horizontal == Distance::kXy;
    run.add_z(rounded(z_up ? position.y() : position.z(), 0.01));
  }
  const auto aligned = [](const AlignmentRecord& a) { return !std::isnan(a.yaw); };
  if (std::ranges::none_of(context.result.alignments, aligned)) return;  // camera images
  for (size_t i = 0; i < context.result.alignments.size(); ++i) {
    const AlignmentRecord& a = context.result.alignments[i];
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
    const MatchLabel& label = result.labels[q];
    task.add_scan(static_cast<int>(match.query));
    for (size_t i = 0; i < matches_per_query; ++i) {
      const bool there = i < match.ranks.size();
      task.add_match(there ? static_cast<int>(match.ranks[i]) : -1);
      task.add_similarity(there ? rounded(match.similarities[i], 1e-5) : 0);
    }
    task.add_score(rounded(match.score, 1e-5));
    task.add_flags(accepted[q] + 2 * label.correct + 4 * label.positive + 8 * label.ignored +
                   16 * (match.which_case == 2));
  }
}

const char* pose_source_of(Distance distance) {
  if (distance == Distance::kPairs) return "list of pairs";
  return distance == Distance::kPlace ? "names of the places" : "poses of the data set";
}

reports::RunTask run_task(const TaskResult& result, const RunContext& context) {
  reports::RunTask task;
  *task.mutable_metrics() = metrics_of(result, context.given.resamples());
  *task.mutable_curve() = drawn_curve(result.curve);
  for (const int64_t scan : result.task.stored)
    if (scan < context.trajectory.size()) task.add_stored(static_cast<int>(scan));
  add_queries(result, task);
  if (!result.histogram) return task;
  reports::Histogram& histogram = *task.mutable_histogram();
  histogram.set_low(result.histogram->low);
  histogram.set_width(result.histogram->width);
  for (const int64_t count : result.histogram->of_correct)
    histogram.add_of_correct(static_cast<double>(count));
  for (const int64_t count : result.histogram->of_incorrect)
    histogram.add_of_incorrect(static_cast<double>(count));
  return task;
}

void set_model(reports::RunInfo& info, const models::FoundModel& model) {
  info.set_model(model.prototxt.string());
  info.set_weights(model.weights.string());
  info.set_weights_sha1(model.weights_sha1);
  info.set_trained(model.trained);
  for (const double mean : model.mean_bgr) info.add_mean_bgr(mean);
}

void set_image(reports::RunInfo& info, const GeometryOptions& image) {
  const ImageGeometry g = image.geometry();
  info.set_image_width(g.width);
  info.set_image_height(g.height);
  info.set_elevation_top_deg(g.elevation_top);
  info.set_elevation_bottom_deg(g.elevation_bottom);
  info.set_max_range_m(g.max_range);
  const auto [closing_width, closing_height] = closing_rectangle(g);
  info.set_closing_width(closing_width);
  info.set_closing_height(closing_height);
  info.set_sensor(image.sensor);
}

void set_times(reports::RunInfo& info, const EvaluationResult& result) {
  for (const StageTimes& stage : stages_of(result)) {
    const profiling::Timing timing = profiling::summarize(stage.ms);
    reports::Stage& out = *info.add_stages();
    out.set_name(stage.name);
    out.set_count(static_cast<int>(stage.ms.size()));
    out.set_median_ms(timing.median);
    out.set_p95_ms(timing.p95);
    out.set_total_ms(sum_of(stage.ms));
  }
  if (const auto speed = frames_per_second(result.describe_times))
    info.set_frames_per_second(*speed);
  if (const auto speed = scans_per_second(result.describe_times)) info.set_scans_per_second(*speed);
}

reports::RunInfo run_info(const RunContext& context) {
  const FeatureOptions& options = context.given.feature;
  const FeatureSource& source = context.source;
  reports::RunInfo info;
  info.set_version(REVISIT_VERSION);
  info.set_data(std::filesystem::absolute(options.data).string());
  info.set_sequence(context.dataset.sequence);
  info.set_scans(static_cast<int>(context.dataset.scans.size()));
  info.set_feature(source.extractor.name);
  info.set_feature_dimension(static_cast<double>(source.extractor.dim));
  if (source.model) {
    set_model(info, *source.model);
  }
  set_image(info, options.image);
  if (!context.result.tasks.empty()) {
    const TaskResult& first = context.result.tasks.front();
    info.set_pca_fit(first.pca_fit);
    info.set_descriptor_dimension(static_cast<int>(first.descriptor_dim));
  }
  info.set_threads(options.thread_count());
  info.set_precision(options.precision == engine::Precision::kBf16 ? "bf16" : "float32");
  set_times(info, context.result);
  info.set_align(name_of(source.align));
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  info.set_peak_resident_bytes(static_cast<double>(usage.ru_maxrss) * 1024);
  const std::vector<AlignmentRecord>& alignments = context.result.alignments;
  for (size_t i = 0; i < alignments.size(); ++i)
    if (alignments[i].described == 0)
      info.add_skipped(std::filesystem::absolute(context.dataset.scans[i].file).string());
  info.set_n_skipped(info.skipped_size());
  info.set_command(command_of(context.given));
  info.set_key(context.key);
  return info;
}

void set_loops(const AcceptedLoops& loops, reports::AcceptedLoops& out) {
  out.set_threshold(loops.threshold);
  out.set_correct(static_cast<int>(loops.correct));
  out.set_ignored(static_cast<int>(loops.ignored));
  out.set_incorrect(static_cast<int>(loops.incorrect));
  if (loops.unlabeled > 0) out.set_unlabeled(static_cast<int>(loops.unlabeled));
}

void set_perturbed(const PerturbedFigures& figures, reports::Metrics& metrics) {
  metrics.set_self(static_cast<int>(figures.self));
  metrics.set_neighbor(static_cast<int>(figures.neighbor));
  if (!std::isnan(figures.ratio_median)) metrics.set_ratio_median(figures.ratio_median);
  if (!std::isnan(figures.ratio_min)) metrics.set_ratio_min(figures.ratio_min);
  metrics.set_n_skipped_queries(static_cast<int>(figures.skipped));
}

}  // namespace

reports::Run run_of(const RunContext& context) {
  reports::Run run;
  *run.mutable_info() = run_info(context);
  for (const auto& [name, value] : settings_of(context.given))
    (*run.mutable_configuration())[name] = value;
  add_scans(context, run);
  for (const TaskResult& result : context.result.tasks)
    *run.add_tasks() = run_task(result, context);
  return run;
}

reports::Metrics metrics_report(const PrSummary& summary, const Task& task,
                                const std::string& pose_source) {
  reports::Metrics metrics;
  metrics.set_protocol(task.name);
  metrics.set_definition(task.definition);
  metrics.set_population(task.population);
  metrics.set_decision(task.decides_on_pairs ? "pair" : "query");
  const MatchRule& rule = task.rule;
  if (rule.distance != Distance::kPairs) metrics.set_radius_m(rule.radius);
  if (rule.negative_radius > rule.radius) metrics.set_negative_radius_m(rule.negative_radius);
  metrics.set_distance(name_of(rule.distance));
  metrics.set_exclusion(to_string(task.exclusion));
  metrics.set_pose_source(pose_source);
  metrics.set_n_queries(static_cast<int>(summary.n_queries));
  metrics.set_n_positives(static_cast<int>(summary.n_positives));
  if (task.decides_on_pairs) {
    metrics.set_n_pairs(static_cast<int>(summary.n_pairs));
    metrics.set_n_correct_pairs(static_cast<int>(summary.n_correct_pairs));
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

reports::Metrics metrics_of(const TaskResult& result, int resamples) {
  reports::Metrics metrics =
      metrics_report(result.summary, result.task, pose_source_of(result.task.rule.distance));
  metrics.set_score(name_of(result.score));
  metrics.set_query_case(result.query_case);
  metrics.set_n_skipped(static_cast<int>(result.n_skipped));
  if (result.intervals) {
    add_intervals(metrics, *result.intervals, resamples, result.n_blocks);
    metrics.set_bootstrap_positive_blocks(static_cast<int>(result.n_positive_blocks));
  }
  if (result.loops) set_loops(*result.loops, *metrics.mutable_loops());
  if (result.perturbed) set_perturbed(*result.perturbed, metrics);
  return metrics;
}

void add_intervals(reports::Metrics& metrics, const PrIntervals& intervals, int resamples,
                   int64_t n_blocks) {
  metrics.set_bootstrap_resamples(resamples);
  metrics.set_bootstrap_blocks(static_cast<int>(n_blocks));
  const auto add = [&](void (reports::Metrics::*adder)(double),
                       const std::array<double, 2>& interval) {
    if (std::isnan(interval[0])) return;
    (metrics.*adder)(interval[0]);
    (metrics.*adder)(interval[1]);
  };
  add(&reports::Metrics::add_f1_max_ci, intervals.f1_max);
  add(&reports::Metrics::add_average_precision_ci, intervals.average_precision);
  add(&reports::Metrics::add_recall_at_1_ci, intervals.recall_at_1);
  add(&reports::Metrics::add_max_recall_at_precision_1_ci, intervals.max_recall_at_precision_1);
  add(&reports::Metrics::add_extended_precision_ci, intervals.extended_precision);
}

reports::Curve drawn_curve(const std::vector<PrPoint>& curve) {
  std::vector<const PrPoint*> kept;
  for (const PrPoint& point : curve) {
    if (std::isnan(point.recall) || std::isnan(point.precision)) continue;
    const bool last = &point == &curve.back();
    if (kept.empty() || last ||
        std::abs(point.recall - kept.back()->recall) +
                std::abs(point.precision - kept.back()->precision) >=
            kCurveStep)
      kept.push_back(&point);
  }
  reports::Curve points;
  const size_t stride = std::max<size_t>(1, (kept.size() + kMaxCurvePoints - 1) / kMaxCurvePoints);
  for (size_t i = 0; i < kept.size(); ++i) {
    if (i % stride != 0 && i + 1 != kept.size()) continue;
    points.add_threshold(rounded(kept[i]->threshold, 1e-5));
    points.add_precision(rounded(kept[i]->precision, 1e-5));
    points.add_recall(rounded(kept[i]->recall, 1e-5));
  }
  return points;
}

std::optional<double> frames_per_second(const DescribeTimes& times) {
  const double total_ms = sum_of(times.processor);
  if (!(total_ms > 0)) return std::nullopt;
  return 1000 * static_cast<double>(times.processor.size()) / total_ms;
}

void print_times(const EvaluationResult& result, std::ostream& out) {
  const DescribeTimes& times = result.describe_times;
  Table table({"stage", "times", "median ms", "p95 ms", "total s"});
  for (const StageTimes& stage : stages_of(result)) {
    const profiling::Timing timing = profiling::summarize(stage.ms);
    table.row({stage.name, str(stage.ms.size()), number(timing.median, 2), number(timing.p95, 2),
               number(sum_of(stage.ms) / 1000, 1)});
  }
  table.print(out);
  if (const auto speed = scans_per_second(times))
    out << "described " << times.feature.size() << " scans in " << number(times.wall_ms / 1000, 1)
        << " s: " << number(*speed, 1) << " scans/s\n";
}

}  // namespace revisit::cli
