#include "evaluation.h"

#include <algorithm>
#include <limits>
#include <set>

#include "cli/json.h"
#include "cli/terminal.h"
#include "eval/run_folder.h"
#include "loops/map_source.h"
#include "loops/recognize.h"
#include "revisit/base/files.h"
#include "revisit/datasets/observer.h"
#include "revisit/loops/loop_detector.h"
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
    options.describe = given.feature.describe(source);
    options.reduction = given.feature.reduction(source);
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

/// Note with the number of listed queries that cannot find their place; "" if there is none.
std::string listed_but_not_asked(const ListedPairs& listed, const TaskResult& result) {
  const auto with_place =
      std::ranges::count_if(listed.correct, [](const auto& pair) { return !pair.second.empty(); });
  const int64_t lost = with_place - result.summary.n_positives;
  if (lost <= 0 || result.perturbed) return "";
  return str(result.task.name, ": ", lost, " of ", with_place,
             " listed queries cannot find their place, because a scan is no query or not stored, "
             "or within the exclusion, or the place comes later");
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

FinishedEvaluation write_run_folder(const EvalOptions& given, const Dataset& dataset,
                                    EvaluationResult&& result, Trajectory&& trajectory,
                                    FeatureSource&& source, const std::string& data_key) {
  print_notes(given.feature.observer(), trajectory, result);
  const fs::path run =
      write_run({given, dataset, trajectory, source, result, key_text(given, data_key)});
  std::vector<std::string> skipped = names_of(result.skipped, dataset);
  return {run, std::move(result), std::move(trajectory), std::move(source), std::move(skipped)};
}

struct DrivingOrderOptions {
  LoopDetectorOptions detector;
  MatchRule rule;                // without a list of pairs
  EvaluationOptions evaluation;  // only score and intervals
  Observer observer;
};

/// `places`: map entries at the time of the query.
TaskQuery query_of(int64_t row, const Detection& found, int64_t places) {
  if (found.excluded.empty()) return {row, {CandidateRange{0, places}, {}}};
  const auto [first, last] = std::ranges::minmax(found.excluded);
  return {row, {CandidateRange{0, first}, CandidateRange{last + 1, places}}};
}

void count(PairLabel truth, AcceptedLoops& loops) {
  if (truth == PairLabel::kIgnored)
    ++loops.ignored;
  else
    ++(truth == PairLabel::kCorrect ? loops.correct : loops.incorrect);
}

AlignmentRecord record_of(bool described) {
  constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();
  return {kUnknown, kUnknown, kUnknown, 0, kUnknown, described ? 1.0F : 0.0F};
}

/// Queries each scan against the scans before it, as `revisit loops` does: one task,
/// "driving-order". `scans`: those of the trajectory, with T_world_sensor.
class DrivingOrder {
 public:
  DrivingOrder(const std::vector<ScanRef>& scans, const Trajectory& trajectory,
               const MapSource& source, const DrivingOrderOptions& options)
      : scans_(scans),
        trajectory_(trajectory),
        source_(source),
        options_(options),
        map_(source.extractor, source.options, nullptr, warn),
        detector_(map_, options.detector) {
    Task& task = task_result_.task;
    task.name = kDrivingOrder;
    task.definition =
        "each scan against the places stored before it, beyond the exclusion, as in revisit loops";
    task.population = "each scan against the places stored before it";
    task.exclusion = options.detector.exclusion;
    task.rule = trajectory.listed ? MatchRule{Distance::kPairs, 0} : options.rule;
    need_distances(trajectory, task.rule.distance, "task " + task.name);
    loops_.threshold = detector_.threshold().value_or(0);
  }

  EvaluationResult run() {
    const revisit::Progress progress = options_.observer.stage("recognizing", "scans");
    recognize(stream_of(scans_), detector_, true, [&](const Visit& visit) {
      progress(++row_ + 1, std::ssize(scans_));
      take(visit);
    });
    check_result();
    task_result_.score = detector_.score();
    task_result_.query_case = name_of(source_.options.align);
    task_result_.pca_fit = source_.extractor.fit_projection
                               ? str("the first ", source_.options.warmup, " distinct places")
                               : "none";
    if (!source_.extractor.fit_projection) task_result_.descriptor_dim = source_.extractor.dim;
    task_result_.n_skipped = std::ssize(result_.skipped);
    if (detector_.threshold()) task_result_.loops = loops_;
    measure(task_result_, trajectory_, options_.evaluation, options_.observer.stop);
    if (trajectory_.listed && task_result_.summary.n_positives == 0)
      throw UsageError("task ", kDrivingOrder, ": none of ", task_result_.task.queries.size(),
                       " listed queries can find its place");
    result_.tasks.push_back(std::move(task_result_));
    return std::move(result_);
  }

 private:
  void take(const Visit& visit) {
    const Detection& found = visit.found;
    result_.alignments.push_back(record_of(found.error.empty()));
    if (!found.error.empty()) {
      options_.observer.warn(found.error + "; the scan is skipped");
      result_.skipped.push_back(row_);
      return;
    }
    result_.recognize_ms.push_back(visit.milliseconds);
    Task& task = task_result_.task;
    const auto places = std::ssize(task.stored);
    if (found.index) task.stored.push_back(row_);
    if (!found.loop) return;
    const int64_t match = task.stored.at(static_cast<size_t>(found.loop->index));
    const bool known = !trajectory_.listed || trajectory_.listed->knows(visit.scan.frame);
    if (found.accepted && !known) ++loops_.unlabeled;
    if (!known) return;
    if (found.accepted) count(pair_label(trajectory_, task.rule, row_, match), loops_);
    task.queries.push_back(query_of(row_, found, places));
    task_result_.matches.push_back({.query = row_,
                                    .ranks = {match},
                                    .similarities = {found.loop->similarity},
                                    .score = found.loop->score,
                                    .relative_yaw = found.loop->relative_yaw});
  }

  void check_result() const {
    if (source_.components >= 0 && !map_.is_warmed_up())
      throw UsageError("the PCA cannot be estimated (expected ", source_.options.warmup,
                       " distinct map entries, found fewer in ", map_.size(),
                       " scans); use a smaller --warmup or more scans");
    if (task_result_.task.queries.empty())
      throw UsageError("task ", kDrivingOrder, ": none of ", scans_.size(),
                       " scans has ground truth and a candidate before it; use a smaller exclusion "
                       "or more scans");
  }

  const std::vector<ScanRef>& scans_;
  const Trajectory& trajectory_;
  const MapSource& source_;
  const DrivingOrderOptions& options_;
  Map map_;
  LoopDetector detector_;
  int64_t row_ = -1;
  AcceptedLoops loops_;
  TaskResult task_result_;
  EvaluationResult result_;
};

DrivingOrderOptions driving_order_options(const EvalOptions& given,
                                          const EvaluationOptions& evaluation,
                                          const Trajectory& trajectory) {
  DrivingOrderOptions how;
  how.evaluation = evaluation;
  const double radius = given.radius.value_or(MatchRule().radius);
  how.rule = {evaluation.distance.value_or(trajectory.horizontal), radius,
              given.negative_radius.value_or(2 * radius)};
  if (how.rule.negative_radius < radius)
    throw UsageError("--negative-radius: expected at least the radius, ", radius, " m, found ",
                     how.rule.negative_radius);
  if (evaluation.exclusion) how.detector.exclusion = *evaluation.exclusion;
  how.detector.keyframes = given.keyframes;
  if (evaluation.score) how.detector.verify = false;  // the score of registered loops is another
  how.detector.keep_clouds = !evaluation.score;
  how.detector.odometry_gate = parse_odometry_gate(given.odometry_gate);
  how.observer = given.feature.observer();
  return how;
}

FinishedEvaluation evaluate_driving(const EvalOptions& options) {
  EvalOptions given = options;
  const EvaluationOptions evaluation = library_options(given);
  const Dataset dataset = given.truth.open(given.feature, needs_poses(evaluation));
  Trajectory trajectory = trajectory_of(given, dataset);
  DrivingOrderOptions how = driving_order_options(given, evaluation, trajectory);
  how.detector.drive = dataset.name;
  MapSource described = map_source(given.feature, dataset, "", ScansAtOnce::kOne, given.warmup);
  described.options.warmup = given.warmup;
  described.options.k = given.k;
  described.options.score = evaluation.score;
  make_folder(given.output);  // first, because the evaluation may take hours
  EvaluationResult result =
      DrivingOrder(given.truth.poses.scans_of(dataset), trajectory, described, how).run();
  described.align = described.options.align;
  return write_run_folder(given, dataset, std::move(result), std::move(trajectory),
                          std::move(described), dataset_key(dataset));
}

void need_others(const Dataset& drive, const Dataset& others, const std::string& folder) {
  std::set<fs::path> scans;
  for (const ScanRef& scan : drive.scans) scans.insert(fs::weakly_canonical(scan.file));
  for (const ScanRef& scan : others.scans)
    if (scans.contains(fs::weakly_canonical(scan.file)))
      throw UsageError("--distractors ", folder, ": ", scan.file.string(),
                       " is a scan of the drive itself; give scans of other places");
}

/// That of the detector, or 50 frames without poses.
Exclusion default_exclusion(const Trajectory& trajectory) {
  return trajectory.positions.empty() ? Exclusion{Exclusion::Kind::kFrames, 50} : Exclusion();
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
  if (!in.options.exclusion && in.trajectory.listed)
    in.options.exclusion = default_exclusion(in.trajectory);
  if (in.source.align != AlignCase::kOne) in.options.query_case.reset();
  EvaluationResult result = evaluate_perturbed(in.dataset, in.trajectory, in.source.extractor,
                                               perturbed_queries(in.given, in.dataset), in.options,
                                               in.given.feature.observer());
  return write_run_folder(in.given, in.dataset, std::move(result), std::move(in.trajectory),
                          std::move(in.source), dataset_key(in.dataset));
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
  const std::string key = in.evaluation.key();  // before its parts move
  return write_run_folder(in.given, in.dataset, std::move(result), std::move(in.trajectory),
                          std::move(in.source), key);
}

std::string write_ground_truth(const EvalOptions& o) {
  const EvaluationOptions options = library_options(o);
  const Dataset dataset = o.truth.open(o.feature, needs_poses(options));
  const Trajectory trajectory = make_trajectory(dataset);
  const MatchRule rule{options.distance.value_or(trajectory.horizontal),
                       options.radius.value_or(MatchRule().radius)};
  const Exclusion exclusion = options.exclusion.value_or(default_exclusion(trajectory));
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
  EvalOptions resolved = given;
  resolved.feature = options;
  const Trajectory unknown;
  const RunContext context{resolved, dataset, unknown, source, result, ""};
  write_scans(output / "scans.csv", context);
  reports::Run run = run_of(context);
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
