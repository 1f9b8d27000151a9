#include "evaluation.h"

#include <algorithm>

#include "eval/causal.h"
#include "eval/points_outside.h"
#include "eval/run_folder.h"

namespace revisit::cli {
namespace {

/// All options but those of description and reduction, which depend on the open feature.
EvaluationOptions library_options(const EvalOptions& o) {
  EvaluationOptions options;
  options.protocols = comma_separated(o.protocol);
  if (o.distance) options.distance = parse_distance(*o.distance);
  options.radius = o.radius;
  options.false_beyond = o.other_beyond;
  if (o.exclusion) options.exclusion = parse_exclusion(*o.exclusion);
  if (o.query_case != "protocol")
    options.query_case = o.query_case == "both" ? QueryCase::kBoth
                         : o.query_case == "2"  ? QueryCase::kTwo
                                                : QueryCase::kAsStored;
  if (o.score) options.score = parse_score(*o.score);
  options.k = o.k;
  options.resamples = o.resamples;
  if (o.block) options.block = parse_exclusion(*o.block, "block");
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
  std::vector<Task> tasks;
  FeatureSource source;
  Evaluation evaluation;

  explicit Opened(const EvalOptions& o)
      : given(o),
        options(library_options(o)),
        dataset(o.truth.open(o.feature, needs_poses(options))),
        sensor_found(resolve_sensor(given.feature, dataset)),
        trajectory(trajectory_of(o, dataset)),
        tasks(evaluation_tasks(options, dataset.sequence, trajectory)),
        source(open_feature(given.feature, dataset, options.cache)),
        evaluation(source.inputs, source.extractor, trajectory, tasks, complete(),
                   given.feature.observer()) {}
  Opened(const Opened&) = delete;  // its parts refer to each other
  Opened& operator=(const Opened&) = delete;

 private:
  EvaluationOptions complete() {
    options.describe = given.feature.describe(source);
    options.reduction = given.feature.reduction(source);
    return options;
  }
};

std::string key_of(const Opened& in) {
  return str("revisit ", REVISIT_VERSION, "\n", command_of(in.given), "\n", in.evaluation.key());
}

}  // namespace

EvaluationKey evaluation_key(const EvalOptions& options) {
  const Opened in(options);
  EvaluationKey key;
  key.text = key_of(in);
  const std::vector<std::filesystem::path> files = in.evaluation.feature_files();
  key.feature = files.front();
  key.feature_dim = in.source.extractor.dim;
  if (in.source.components >= 0)  // otherwise the features are the descriptors
    for (const std::filesystem::path& file : files)
      key.large_files.insert(key.large_files.end(), {file, file.string() + ".key"});
  return key;
}

namespace {

struct RunParts {
  const EvalOptions& given;
  const Dataset& dataset;
  const FeatureSource& source;
  std::string key;
};

FinishedEvaluation write_run_folder(const RunParts& parts, Trajectory trajectory,
                                    EvaluationResult result) {
  const FeatureOptions& feature = parts.given.feature;
  FinishedEvaluation finished;
  for (const int64_t row : result.skipped)
    finished.skipped.push_back(
        parts.dataset.scans[static_cast<size_t>(row)].file.filename().string());
  if (trajectory.listed)
    for (const TaskResult& task : result.tasks)
      if (const std::string lost = listed_but_not_asked(*trajectory.listed, task); !lost.empty())
        feature.observer().note(lost);
  for (const TaskResult& task : result.tasks)
    if (constexpr int64_t kFew = 10; task.intervals && task.blocks.positive < kFew)
      feature.observer().warn(
          str(task.task.name, ": only ", task.blocks.positive, " of ", task.blocks.all,
              " blocks have a query with a true match, so ",
              "the intervals are too narrow; give shorter blocks with --block"));
  finished.run = make_run_folder(parts.given.output, parts.dataset);
  const RunContext context{feature,
                           parts.dataset,
                           trajectory,
                           parts.source,
                           result.alignments,
                           settings_of(parts.given),
                           command_of(parts.given),
                           parts.key,
                           parts.given.resamples};
  write_run(finished.run, context, result.tasks, result.times);
  link_latest(finished.run);
  finished.result = std::move(result);
  finished.trajectory = std::move(trajectory);
  finished.feature = parts.source.extractor.name;
  finished.similarity = similarity_name(parts.source);
  finished.feature_dim = parts.source.extractor.dim;
  finished.reduced = parts.source.components >= 0;
  finished.trained = !parts.source.model || parts.source.model->trained;
  return finished;
}

FinishedEvaluation evaluate_online(const EvalOptions& options) {
  EvalOptions given = options;
  CausalOptions how;
  how.evaluation = library_options(given);
  const double radius = given.radius.value_or(TrueMatchRule().radius);
  how.rule = {how.evaluation.distance.value_or(Distance::kXz), radius,
              given.other_beyond.value_or(2 * radius)};
  if (how.rule.false_beyond < radius)
    throw UsageError("--negative-radius: expected at least the radius, ", radius, " m, found ",
                     how.rule.false_beyond);
  if (how.evaluation.exclusion) how.detector.exclusion = *how.evaluation.exclusion;
  how.detector.keyframes = parse_keyframes(given.keyframes);
  if (given.no_verify) how.detector.verify = false;
  how.detector.keep_clouds = !given.no_verify;
  how.observer = given.feature.observer();
  const Dataset dataset = given.truth.open(given.feature, needs_poses(how.evaluation));
  how.detector.drive = dataset.name;
  Trajectory trajectory = trajectory_of(given, dataset);
  RecognizerSource described =
      recognizer_source(given.feature, dataset, "", ScansAtOnce::kOne, given.warmup);
  described.options.warmup = given.warmup;
  described.options.k = given.k;
  described.options.score = how.evaluation.score;
  EvaluationResult result =
      evaluate_causally(given.truth.poses.scans_of(dataset), trajectory, described, how);
  FeatureSource source;
  source.align = described.options.align;
  source.extractor = std::move(described.extractor);
  source.model = std::move(described.model);
  source.components = described.components;
  const std::string key =
      str("revisit ", REVISIT_VERSION, "\n", command_of(given), "\n", dataset_key(dataset));
  return write_run_folder({given, dataset, source, key}, std::move(trajectory), std::move(result));
}

}  // namespace

FinishedEvaluation evaluate(const EvalOptions& options) {
  if (options.causal) return evaluate_online(options);
  Opened in(options);
  const FeatureOptions& feature = in.given.feature;
  if (!in.sensor_found.empty()) feature.observer().note("sensor: " + in.sensor_found);
  EvaluationResult result = in.evaluation.run();
  warn_of_points_outside(feature, in.source.inputs, result.alignments);
  const RunParts parts{in.given, in.dataset, in.source,
                       key_of(in)};  // before the trajectory is moved
  return write_run_folder(parts, std::move(in.trajectory), std::move(result));
}

}  // namespace revisit::cli
