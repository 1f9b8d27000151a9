#include "evaluation.h"

#include <algorithm>
#include <numbers>
#include <set>

#include "cli/json.h"
#include "cli/table.h"
#include "eval/driving_order.h"
#include "eval/run_folder.h"
#include "revisit/base/files.h"
#include "revisit/datasets/observer.h"
#include "revisit/proto/npy.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// All options but those of description and reduction, which depend on the open feature.
EvaluationOptions library_options(const EvalOptions& o) {
  EvaluationOptions options;
  options.protocols = comma_separated(o.protocol);
  if (o.distance) options.distance = parse_distance(*o.distance);
  options.radius = o.radius;
  options.negative_radius = o.negative_radius;
  if (o.exclusion) options.exclusion = parse_exclusion(*o.exclusion);
  if (o.query_case != "protocol")
    options.query_case = o.query_case == "both" ? QueryCase::kBoth
                         : o.query_case == "2"  ? QueryCase::kTwo
                                                : QueryCase::kAsStored;
  if (o.score) options.score = parse_score(*o.score);
  options.k = o.k;
  options.resamples = o.resamples();
  if (!o.block().empty()) options.block = parse_exclusion(o.block(), "block");
  options.threads = o.feature.thread_count();
  options.cache = o.feature.cache_folder(o.output);
  options.keep_descriptors = !o.feature.cache.empty();
  return options;
}

void complete(EvaluationOptions& options, const EvalOptions& given, const FeatureSource& source) {
  options.describe = given.feature.describe(source);
  options.reduction = given.feature.reduction(source);
}

/// Named places are ground truth enough for some protocols.
bool needs_poses(const EvaluationOptions& options) {
  if (options.distance) return options.distance != Distance::kPlace;
  return !std::ranges::all_of(options.protocols,
                              [](const std::string& name) { return name.starts_with("places-"); });
}

Trajectory trajectory_of(const EvalOptions& o, const Dataset& dataset) {
  Trajectory trajectory = make_trajectory(dataset);
  trajectory.listed = o.truth.listed(o.feature);
  return trajectory;
}

struct Opened {
  EvalOptions given;  // with the resolved sensor
  EvaluationOptions options;
  Dataset dataset;
  std::string sensor_found;
  Trajectory trajectory;
  FeatureSource source;

  explicit Opened(const EvalOptions& o)
      : given(o),
        options(library_options(o)),
        dataset(o.truth.open(o.feature, needs_poses(options))),
        sensor_found(resolve_sensor(given.feature, dataset)),
        trajectory(trajectory_of(o, dataset)),
        source(open_feature(given.feature, dataset, options.cache)) {
    complete(options, given, source);
  }
  void note_sensor() const {
    if (!sensor_found.empty()) given.feature.observer().note("sensor: " + sensor_found);
  }
};

/// Of protocols of the library.
struct OpenedTasks : Opened {
  std::vector<Task> tasks;
  Evaluation evaluation;

  explicit OpenedTasks(const EvalOptions& o)
      : Opened(o),
        tasks(evaluation_tasks(options, dataset.sequence, trajectory)),
        evaluation(source.inputs, source.extractor, trajectory, tasks, options,
                   given.feature.observer()) {}
  OpenedTasks(const OpenedTasks&) = delete;  // its parts refer to each other
  OpenedTasks& operator=(const OpenedTasks&) = delete;
};

std::string key_text(const EvalOptions& given, const std::string& data) {
  return str("revisit ", REVISIT_VERSION, "\n", command_of(given), "\n", data);
}

std::vector<std::string> names_of(const std::vector<int64_t>& rows, const Dataset& dataset) {
  std::vector<std::string> names;
  for (const int64_t row : rows)
    names.push_back(dataset.scans[static_cast<size_t>(row)].file.filename().string());
  return names;
}

void print_notes(const Observer& observer, const Trajectory& trajectory,
                 const EvaluationResult& result) {
  if (trajectory.listed)
    for (const TaskResult& task : result.tasks)
      if (const std::string lost = listed_but_not_asked(*trajectory.listed, task); !lost.empty())
        observer.note(lost);
  for (const TaskResult& task : result.tasks)
    if (constexpr int64_t kFew = 10; task.intervals && task.n_positive_blocks < kFew)
      observer.warn(str(task.task.name, ": ", task.n_positive_blocks, " of ", task.n_blocks,
                        " blocks have a query with a correct match, so the intervals are too "
                        "narrow (expected at least ",
                        kFew, "); give shorter blocks with --bootstrap"));
}

FinishedEvaluation write_run_folder(const RunContext& context, EvaluationResult&& result,
                                    Trajectory&& trajectory) {
  print_notes(context.given.feature.observer(), trajectory, result);
  FinishedEvaluation finished;
  finished.run = make_run_folder(context.given.output, context.dataset);
  write_run(finished.run, context);
  link_latest(finished.run);
  const FeatureSource& source = context.source;
  finished.skipped = names_of(result.skipped, context.dataset);
  finished.feature = source.extractor.name;
  finished.similarity = similarity_name(source);
  finished.feature_dim = source.extractor.dim;
  finished.reduced = source.components >= 0;
  finished.trained = !source.model || source.model->trained;
  finished.result = std::move(result);
  finished.trajectory = std::move(trajectory);
  return finished;
}

DrivingOrderOptions driving_order_options(const EvalOptions& given,
                                          const EvaluationOptions& evaluation) {
  DrivingOrderOptions how;
  how.evaluation = evaluation;
  const double radius = given.radius.value_or(MatchRule().radius);
  how.rule = {evaluation.distance.value_or(Distance::kXz), radius,
              given.negative_radius.value_or(2 * radius)};
  if (how.rule.negative_radius < radius)
    throw UsageError("--negative-radius: expected at least the radius, ", radius, " m, found ",
                     how.rule.negative_radius);
  if (evaluation.exclusion) how.detector.exclusion = *evaluation.exclusion;
  how.detector.keyframes = given.keyframes;
  if (evaluation.score) how.detector.verify = false;  // the score of registered loops is another
  how.detector.keep_clouds = !evaluation.score;
  how.observer = given.feature.observer();
  return how;
}

FinishedEvaluation evaluate_driving(const EvalOptions& options) {
  EvalOptions given = options;
  const EvaluationOptions evaluation = library_options(given);
  DrivingOrderOptions how = driving_order_options(given, evaluation);
  const Dataset dataset = given.truth.open(given.feature, needs_poses(evaluation));
  how.detector.drive = dataset.name;
  Trajectory trajectory = trajectory_of(given, dataset);
  RecognizerSource described =
      recognizer_source(given.feature, dataset, "", ScansAtOnce::kOne, given.warmup);
  described.options.warmup = given.warmup;
  described.options.k = given.k;
  described.options.score = evaluation.score;
  make_folder(given.output);  // first, because the evaluation may take hours
  EvaluationResult result =
      evaluate_in_driving_order(given.truth.poses.scans_of(dataset), trajectory, described, how);
  FeatureSource source;
  source.align = described.options.align;
  source.extractor = std::move(described.extractor);
  source.model = std::move(described.model);
  source.components = described.components;
  const RunContext context{given,  dataset, trajectory,
                           source, result,  key_text(given, dataset_key(dataset))};
  return write_run_folder(context, std::move(result), std::move(trajectory));
}

void need_others(const Dataset& drive, const Dataset& others, const std::string& folder) {
  std::set<fs::path> scans;
  for (const ScanRef& scan : drive.scans) scans.insert(fs::weakly_canonical(scan.file));
  for (const ScanRef& scan : others.scans)
    if (scans.contains(fs::weakly_canonical(scan.file)))
      throw UsageError("--distractors ", folder, ": ", scan.file.string(),
                       " is a scan of the drive itself; give scans of other places");
}

PerturbedQueries perturbed_queries(const EvalOptions& o, const Dataset& drive) {
  PerturbedQueries perturbed;
  perturbed.perturbations = parse_perturbations(o.perturb);
  perturbed.seed = o.seed;
  perturbed.n = o.queries;
  for (const std::string& folder : comma_separated(o.distractors)) {
    perturbed.distractors.push_back(open_dataset(folder, ""));
    need_others(drive, perturbed.distractors.back(), folder);
    for (const std::string& warning : perturbed.distractors.back().warnings)
      o.feature.observer().warn(warning);
  }
  return perturbed;
}

FinishedEvaluation evaluate_perturbed_queries(const EvalOptions& options) {
  Opened in(options);
  in.note_sensor();
  if (!in.options.exclusion && in.trajectory.listed) in.options.exclusion = Exclusion();
  if (in.source.align != AlignCase::kOne) in.options.query_case.reset();
  EvaluationResult result = evaluate_perturbed(in.dataset, in.trajectory, in.source.extractor,
                                               perturbed_queries(in.given, in.dataset), in.options,
                                               in.given.feature.observer());
  const RunContext context{in.given,  in.dataset, in.trajectory,
                           in.source, result,     key_text(in.given, dataset_key(in.dataset))};
  return write_run_folder(context, std::move(result), std::move(in.trajectory));
}

void write_frames(const fs::path& file, const Dataset& dataset,
                  const std::vector<AlignmentRecord>& alignments) {
  Table table({"row", "frame", "file", "time", "yaw_deg", "eigenvalue_ratio", "abs_t11",
               "mirrored_choice", "outside", "described"});
  for (size_t i = 0; i < dataset.scans.size(); ++i) {
    const ScanRef& scan = dataset.scans[i];
    const AlignmentRecord& a = alignments[i];
    table.row({str(i), str(scan.frame), scan.file.string(), scan.time ? number(*scan.time, 6) : "",
               number(a.yaw * 180 / std::numbers::pi, 3), number(a.eigenvalue_ratio, 4),
               number(a.abs_t11, 4), number(a.mirrored_choice, 0), number(a.outside, 4),
               number(a.described, 0)});
  }
  write_atomically(file, [&](std::ostream& out) { table.print_csv(out); });
}

}  // namespace

EvaluationKey evaluation_key(const EvalOptions& options) {
  EvaluationKey key;
  if (options.in_driving_order() || !options.perturb.empty()) {
    const Dataset dataset = options.truth.open(options.feature, true);
    key.text = key_text(options, dataset_key(dataset));
    return key;
  }
  const OpenedTasks in(options);
  key.text = key_text(in.given, in.evaluation.key());
  const std::vector<fs::path> files = in.evaluation.feature_files();
  key.feature = files.front();
  if (in.source.components >= 0)  // otherwise the features are the descriptors
    key.large_files = files;
  return key;
}

FinishedEvaluation evaluate(const EvalOptions& options) {
  if (options.in_driving_order()) return evaluate_driving(options);
  if (!options.perturb.empty()) return evaluate_perturbed_queries(options);
  OpenedTasks in(options);
  in.note_sensor();
  EvaluationResult result = in.evaluation.run();
  warn_of_points_outside(in.given.feature, in.source.inputs, result.alignments);
  const RunContext context{in.given,  in.dataset, in.trajectory,
                           in.source, result,     key_text(in.given, in.evaluation.key())};
  return write_run_folder(context, std::move(result), std::move(in.trajectory));
}

std::string write_ground_truth(const EvalOptions& o) {
  const EvaluationOptions options = library_options(o);
  const Dataset dataset = o.truth.open(o.feature, needs_poses(options));
  const Trajectory trajectory = make_trajectory(dataset);
  const MatchRule rule{options.distance.value_or(Distance::kXz),
                       options.radius.value_or(MatchRule().radius)};
  const Exclusion exclusion = options.exclusion.value_or(Exclusion());
  const auto pairs = find_loops(trajectory, rule, exclusion);
  std::set<int64_t> positives;
  Table table({"query", "match", "distance_m"});
  for (const auto& [query, match] : pairs) {
    positives.insert(query);
    table.row({str(trajectory.frames[static_cast<size_t>(query)]),
               str(trajectory.frames[static_cast<size_t>(match)]),
               number(distance_between(trajectory, query, match, rule.distance), 3)});
  }
  write_atomically(o.ground_truth, [&](std::ostream& out) { table.print_csv(out); });
  const auto without = std::ranges::count(earlier_candidates(trajectory, exclusion), 0);
  return str(positives.size(), " of ", trajectory.size() - without,
             " queries have a correct match: ", pairs.size(), " pairs");
}

DescribedScans write_descriptors(const EvalOptions& given) {
  FeatureOptions options = given.feature;
  const fs::path& output = given.descriptors;
  if (options.fitted_on() == "map")
    throw UsageError("--fit-on map: needs stored scans, which --descriptors has not");
  const Dataset dataset = open_scans(options);
  const Observer observer = options.observer();
  if (const std::string found = resolve_sensor(options, dataset); !found.empty())
    observer.note("sensor: " + found);
  make_folder(output);  // first, because describing may take hours
  const fs::path cache = options.cache_folder(output);
  const FeatureSource source = open_feature(options, dataset, cache);
  DatasetFeatures features(source.inputs, source.extractor, options.describe(source), cache,
                           observer);
  features.file();  // described here, so that the time of the reduction is separate
  warn_of_points_outside(options, source.inputs, features.alignments());
  EvaluationResult result;
  result.alignments = features.alignments();
  result.describe_times = features.times();

  const bool fits = options.fitted_on() == "all";
  auto lap = stopwatch();
  const Descriptors descriptors = reduce(options.reduction(source), {}, features, nullptr, observer,
                                         fits ? output / "pca" : fs::path());
  result.reduce_ms.push_back(lap());
  if (!descriptors.note.empty()) observer.note(descriptors.note);
  const FloatMatrix& matrix = descriptors.case1;
  proto::write_npy(output / "descriptors.npy", {matrix.n, matrix.d}, matrix.values.data());
  write_frames(output / "frames.csv", dataset, result.alignments);
  EvalOptions resolved = given;
  resolved.feature = options;
  const Trajectory unknown;
  reports::Run run = run_of({resolved, dataset, unknown, source, result, ""});
  run.mutable_info()->set_pca_fit(descriptors.pca_fit);
  run.mutable_info()->set_descriptor_dimension(static_cast<int>(matrix.d));
  write_json(output / "run.json", run);
  return {source.extractor.name,
          descriptors.pca_fit,
          matrix.n,
          source.extractor.dim,
          names_of(features.skipped(), dataset),
          std::move(result)};
}

}  // namespace revisit::cli
