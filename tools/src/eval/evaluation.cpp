#include "evaluation.h"

#include <algorithm>

#include "eval/points_outside.h"
#include "eval/run_folder.h"

namespace revisit::cli {
namespace {

/// All but what describes and reduces, which is known once the feature is open.
pipeline::EvaluationOptions library_options(const EvalOptions& o) {
  pipeline::EvaluationOptions options;
  options.protocols = comma_separated(o.protocol);
  if (o.distance) options.distance = pipeline::parse_distance(*o.distance);
  options.radius = o.radius;
  if (o.exclusion) options.exclusion = pipeline::parse_exclusion(*o.exclusion);
  if (o.query_case != "protocol")
    options.query_case = o.query_case == "both" ? pipeline::QueryCase::kBoth
                         : o.query_case == "2"  ? pipeline::QueryCase::kTwo
                                                : pipeline::QueryCase::kAsStored;
  if (o.score) options.score = pipeline::parse_score(*o.score);
  options.k = o.k;
  options.resamples = o.resamples;
  options.threads = o.feature.thread_count();
  options.cache = o.feature.cache_folder(o.output);
  options.keep_descriptors = !o.feature.cache.empty();
  return options;
}

/// Named places are truth enough where nothing else is asked for.
bool needs_poses(const pipeline::EvaluationOptions& options) {
  if (options.distance) return options.distance != pipeline::Distance::kPlace;
  return !std::ranges::all_of(options.protocols,
                              [](const std::string& name) { return name.starts_with("places-"); });
}

struct Opened {
  EvalOptions given;  // but that the sensor is known
  pipeline::EvaluationOptions options;
  pipeline::Dataset dataset;
  std::string sensor_found;  // for people
  pipeline::Trajectory trajectory;
  std::vector<pipeline::Task> tasks;
  FeatureSource source;
  pipeline::Evaluation evaluation;

  explicit Opened(const EvalOptions& o)
      : given(o),
        options(library_options(o)),
        dataset(open_scans(o.feature, {.poses = needs_poses(options)})),
        sensor_found(resolve_sensor(given.feature, dataset)),
        trajectory(pipeline::make_trajectory(dataset)),
        tasks(pipeline::evaluation_tasks(options, dataset.sequence, trajectory)),
        source(open_feature(given.feature, dataset, options.cache)),
        evaluation(source.inputs, source.extractor, trajectory, tasks, complete(),
                   given.feature.observer()) {}
  Opened(const Opened&) = delete;  // its parts refer to each other
  Opened& operator=(const Opened&) = delete;

 private:
  pipeline::EvaluationOptions complete() {
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
  if (in.source.components >= 0)  // else the features are the descriptors
    for (const std::filesystem::path& file : files)
      key.large_files.insert(key.large_files.end(), {file, file.string() + ".key"});
  return key;
}

FinishedEvaluation evaluate(const EvalOptions& options) {
  Opened in(options);
  const FeatureOptions& feature = in.given.feature;
  if (!in.sensor_found.empty()) feature.observer().note("sensor: " + in.sensor_found);
  FinishedEvaluation finished;
  finished.result = in.evaluation.run();
  const pipeline::EvaluationResult& result = finished.result;
  for (const int64_t row : result.left_out)
    finished.left_out.push_back(
        in.dataset.scans[static_cast<size_t>(row)].file.filename().string());
  warn_of_points_outside(feature, in.source.inputs, result.alignments);

  finished.run = make_run_folder(options.output, in.dataset);
  const RunContext context{feature,
                           in.dataset,
                           in.trajectory,
                           in.source,
                           result.alignments,
                           settings_of(in.given),
                           command_of(in.given),
                           key_of(in),
                           options.resamples};
  write_run(finished.run, context, result.tasks, result.times);
  link_latest(finished.run);
  finished.trajectory = std::move(in.trajectory);
  finished.feature = in.source.extractor.name;
  finished.similarity = similarity_name(in.source);
  finished.feature_dim = in.source.extractor.dim;
  finished.reduced = in.source.components >= 0;
  finished.trained = !in.source.model || in.source.model->trained;
  return finished;
}

}  // namespace revisit::cli
