#include "evaluation.h"

#include <algorithm>
#include <iostream>
#include <iterator>
#include <set>
#include <sstream>

#include "cli/interrupt.h"
#include "cli/progress.h"
#include "eval/descriptors.h"
#include "eval/points_outside.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// To be raised with every change after which the same features give other figures: protocols,
/// retrieval, precision and recall. (What changes the features is in their own key.)
constexpr int kEvaluationVersion = 1;

/// What `--protocol` lists.
std::vector<std::string> protocol_names(const EvalOptions& o) {
  std::istringstream list(o.protocol);
  std::vector<std::string> names;
  for (std::string name; std::getline(list, name, ',');) names.push_back(name);
  return names;
}

/// Named places are truth enough where nothing else is asked for.
bool needs_poses(const EvalOptions& o) {
  if (o.distance) return pipeline::parse_distance(*o.distance) != pipeline::Distance::kPlace;
  return !std::ranges::all_of(protocol_names(o),
                              [](const std::string& name) { return name.starts_with("places-"); });
}

std::vector<pipeline::Task> tasks_for(const EvalOptions& o, const pipeline::Dataset& dataset,
                                      const pipeline::Trajectory& trajectory) {
  std::optional<pipeline::Exclusion> exclusion;
  if (o.exclusion) exclusion = pipeline::parse_exclusion(*o.exclusion);
  std::vector<pipeline::Task> tasks;
  for (const std::string& name : protocol_names(o))
    for (pipeline::Task& task :
         pipeline::make_tasks(name, dataset.sequence, trajectory, exclusion)) {
      if (o.distance) task.rule.distance = pipeline::parse_distance(*o.distance);
      if (o.radius) task.rule.radius = *o.radius;
      if (o.query_case != "protocol") task.both_cases = o.query_case == "both";
      need_distances(trajectory, task.rule.distance, "task " + task.name);
      if (std::ranges::any_of(tasks, [&](const auto& other) { return other.name == task.name; }))
        throw UsageError(str("--protocol ", o.protocol, ": ", task.name, " is in it twice"));
      tasks.push_back(std::move(task));
    }
  if (tasks.empty()) throw UsageError("--protocol: give at least one name");
  return tasks;
}

/// How sure a match is, by default: the features that are compared in their own way say it
/// themselves. Otherwise the protocol says it.
pipeline::Score score_for(const EvalOptions& o, const FeatureSource& source,
                          const pipeline::Task& task) {
  if (o.score) return pipeline::parse_score(*o.score);
  return source.extractor.similarity || !task.margin_score ? pipeline::Score::kBest
                                                           : pipeline::Score::kMargin;
}

/// Queries in case 2 alone, stored scans in case 1.
std::vector<pipeline::Match> retrieve_case2(const Descriptors& descriptors,
                                            const pipeline::Task& task,
                                            const pipeline::RetrieveOptions& options) {
  pipeline::FloatMatrix mixed = descriptors.case1;
  for (const pipeline::TaskQuery& query : task.queries)
    std::ranges::copy(descriptors.case2->row(query.scan), mixed.row(query.scan).begin());
  std::vector<pipeline::Match> matches = pipeline::retrieve(mixed, task, options);
  for (pipeline::Match& match : matches) match.which_case = 2;
  return matches;
}

/// Says each thing once, whatever the number of tasks it is true of.
struct Notes {
  bool quiet;
  std::set<std::string> said;
  void say(const std::string& note) {
    if (said.insert(note).second && !quiet) std::cerr << "note: " << note << "\n";
  }
};

enum class QueryCase { kAsStored, kCase2, kBoth };

QueryCase query_case_of(const EvalOptions& o, const FeatureSource& source,
                        const pipeline::Task& task) {
  if (source.align != pipeline::AlignCase::kOne) return QueryCase::kAsStored;
  if (o.query_case == "2") return QueryCase::kCase2;
  return task.both_cases ? QueryCase::kBoth : QueryCase::kAsStored;
}

TaskResult run_task(const EvalOptions& o, const FeatureSource& source, const pipeline::Task& task,
                    const pipeline::Trajectory& trajectory, TaskDescriptors& all_descriptors,
                    int64_t n_left_out, Notes& notes, RunTimes* times) {
  TaskResult result;
  result.task = task;
  result.rule = task.rule;
  result.n_left_out = n_left_out;
  const QueryCase query_case = query_case_of(o, source, task);
  result.query_case = query_case == QueryCase::kBoth    ? "both"
                      : query_case == QueryCase::kCase2 ? "case2"
                                                        : pipeline::name_of(source.align);
  if (task.both_cases && query_case != QueryCase::kBoth)
    notes.say(str(task.name,
                  " asks each query in both alignment cases, which takes --align case1: ",
                  "here each is asked once"));
  const Descriptors* found = nullptr;
  times->reduce.push_back(milliseconds_of([&] { found = &all_descriptors.of(task); }));
  const Descriptors& descriptors = *found;
  if (!descriptors.note.empty()) notes.say(descriptors.note);
  result.pca_fit = descriptors.pca_fit;
  result.descriptor_dim = descriptors.case1.d;

  Progress progress(result.on_pairs() ? "comparing" : "retrieving", "queries",
                    !o.feature.no_progress && !o.feature.quiet);
  const int threads = o.feature.thread_count();
  std::optional<pipeline::BootstrapOptions> bootstrap;
  if (o.resamples > 0)
    bootstrap = {.resamples = o.resamples, .threads = threads, .stop = interrupted};
  if (result.on_pairs()) {
    result.score = pipeline::Score::kBest;
    pipeline::PairResult pairs;
    times->retrieve.push_back(milliseconds_of([&] {
      pairs = pipeline::evaluate_pairs(
          task, trajectory,
          pipeline::pair_similarity(descriptors.case1, source.extractor.similarity),
          {threads, bootstrap, progress.callback(), interrupted});
    }));
    result.curve = std::move(pairs.curve);
    result.summary = pairs.summary;
    result.intervals = pairs.intervals;
    result.histogram = pairs.histogram;
    return result;
  }
  result.score = score_for(o, source, task);
  const pipeline::RetrieveOptions retrieve{
      o.k, result.score, progress.callback(), interrupted, source.extractor.similarity, threads};
  times->retrieve.push_back(milliseconds_of([&] {
    result.matches =
        query_case == QueryCase::kCase2
            ? retrieve_case2(descriptors, task, retrieve)
            : pipeline::retrieve(descriptors.case1, task, retrieve,
                                 query_case == QueryCase::kBoth ? &*descriptors.case2 : nullptr);
  }));
  result.verdicts = pipeline::judge(result.matches, task, trajectory, task.rule);
  result.curve = pipeline::precision_recall(result.verdicts, task.missed);
  result.summary = pipeline::summarize(result.verdicts, task.missed);
  if (bootstrap) result.intervals = pipeline::bootstrap(result.verdicts, task.missed, *bootstrap);
  return result;
}

void check_query_case(const EvalOptions& o, const FeatureSource& source,
                      const pipeline::Task& task) {
  if (o.query_case == "protocol" || o.query_case == "1") return;
  if (source.align != pipeline::AlignCase::kOne)
    throw UsageError("--query-case " + o.query_case + " needs --align case1");
  if (task.decision == pipeline::Decision::kPair)
    throw UsageError(str("--query-case ", o.query_case, ": task ", task.name,
                         " compares pairs of scans, each in one case"));
  if (o.query_case == "both") return;
  // A scan that is stored and asked has one row only: case 2 would change it on both sides.
  std::vector<int64_t> asked;
  for (const pipeline::TaskQuery& query : task.queries) asked.push_back(query.scan);
  std::vector<int64_t> both;
  std::ranges::set_intersection(task.stored, asked, std::back_inserter(both));
  if (!both.empty())
    throw UsageError(str("--query-case 2: task ", task.name,
                         " asks scans that it also stores; use a task that keeps them apart"));
}

/// All that an evaluation works on.
struct Inputs {
  EvalOptions o;  // as given, but that the sensor is known
  pipeline::Dataset dataset;
  std::string sensor_found;  // for people
  pipeline::Trajectory trajectory;
  std::vector<pipeline::Task> tasks;
  fs::path cache;
  FeatureSource source;
  LazyFeatures case1, case2;

  explicit Inputs(const EvalOptions& given)
      : o(given),
        dataset(open_scans(o.feature, {.poses = needs_poses(o)})),
        sensor_found(resolve_sensor(o.feature, dataset)),
        trajectory(pipeline::make_trajectory(dataset)),
        tasks(tasks_for(o, dataset, trajectory)),
        cache(o.feature.cache_folder(o.output)),
        source(open_feature(o.feature, dataset, cache)),
        case1(o.feature, source, source.align, cache),
        case2(o.feature, source, pipeline::AlignCase::kTwo, cache) {
    for (const pipeline::Task& task : tasks) check_query_case(o, source, task);
  }
  Inputs(const Inputs&) = delete;  // the features refer to the source
  Inputs& operator=(const Inputs&) = delete;

  bool needs_case2() const {
    return source.align == pipeline::AlignCase::kOne &&
           (o.query_case == "2" || std::ranges::any_of(tasks, &pipeline::Task::both_cases));
  }
};

}  // namespace

EvaluationKey evaluation_key(const EvalOptions& options) {
  const Inputs in(options);
  EvaluationKey key;
  key.text = str("revisit ", REVISIT_VERSION, " evaluation ", kEvaluationVersion, "\n",
                 command_of(in.o), "\n", in.case1.key(), "poses");
  for (const Eigen::Vector3d& p : in.trajectory.positions)
    key.text += str(" ", p.x(), ",", p.y(), ",", p.z());
  key.feature = in.case1.path();
  if (in.source.components < 0) return key;  // the features are the descriptors
  key.large_files = {in.case1.path()};
  if (in.needs_case2()) key.large_files.push_back(in.case2.path());
  return key;
}

Evaluation evaluate(const EvalOptions& options) {
  Inputs in(options);
  const EvalOptions& o = in.o;
  if (!in.sensor_found.empty() && !o.feature.quiet)
    std::cerr << "note: sensor: " << in.sensor_found << "\n";
  Evaluation result;
  LazyFeatures* case2 = in.needs_case2() ? &in.case2 : nullptr;
  TaskDescriptors descriptors(o.feature, in.source.components, in.case1, case2,
                              o.feature.cache.empty() ? fs::path() : in.cache);
  Notes notes{o.feature.quiet, {}};
  const std::vector<int64_t> left_out = descriptors.left_out();
  for (const int64_t row : left_out)
    result.left_out.push_back(in.dataset.scans[static_cast<size_t>(row)].file.filename().string());
  for (pipeline::Task& task : in.tasks) {
    if (!left_out.empty()) pipeline::leave_out(task, left_out);
    result.tasks.push_back(run_task(o, in.source, task, in.trajectory, descriptors,
                                    static_cast<int64_t>(left_out.size()), notes, &result.times));
  }
  warn_of_points_outside(o.feature, in.source.inputs, in.case1.alignments());
  result.times.describe = in.case1.times();
  if (case2) result.times.describe.append(case2->times());

  result.run = make_run_folder(o.output, in.dataset);
  const RunContext context{
      o.feature,      in.dataset,    in.trajectory, in.source, in.case1.alignments(),
      settings_of(o), command_of(o), o.resamples};
  write_run(result.run, context, result.tasks, result.times);
  link_latest(result.run);
  result.trajectory = std::move(in.trajectory);
  result.feature = in.source.extractor.name;
  result.similarity = similarity_name(in.source);
  result.feature_dim = in.source.extractor.dim;
  result.reduced = in.source.components >= 0;
  result.trained = !in.source.model || in.source.model->trained;
  return result;
}

}  // namespace revisit::cli
