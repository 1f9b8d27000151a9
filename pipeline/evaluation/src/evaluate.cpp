#include "revisit/evaluation/evaluate.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <tuple>

#include "revisit/base/text.h"
#include "revisit/datasets/observer.h"

namespace revisit {
namespace {

/// Must be raised if the same features yield other metrics.
constexpr int kEvaluationVersion = 3;

DescribeOptions in_case(DescribeOptions options, AlignCase align) {
  options.align = align;
  return options;
}

void check_query_case(const EvaluationOptions& options, const Task& task) {
  if (!options.query_case || options.query_case == QueryCase::kAsStored) return;
  const char* const option = "query case";
  const char* const requested = options.query_case == QueryCase::kBoth ? " both" : " 2";
  if (options.describe.align != AlignCase::kOne)
    throw UsageError(option, requested, " needs align case1");
  if (task.decides_on_pairs)
    throw UsageError(option, requested, ": task ", task.name,
                     " compares pairs of scans, each in one case");
  if (options.query_case == QueryCase::kBoth) return;
  // A scan that is both stored and queried has a single row: case 2 would change both sides.
  std::vector<int64_t> queries, both;
  for (const TaskQuery& query : task.queries) queries.push_back(query.scan);
  std::ranges::set_intersection(task.stored, queries, std::back_inserter(both));
  if (!both.empty())
    throw UsageError(option, requested, ": task ", task.name,
                     " queries scans that it also stores; use a task with separate queries");
}

BootstrapOptions resampling(const Task& task, const Trajectory& trajectory,
                            const EvaluationOptions& options, const std::function<bool()>& stop) {
  BootstrapOptions bootstrap{
      .resamples = options.resamples, .threads = options.threads, .stop = stop};
  if (options.resamples > 0) bootstrap.blocks = blocks_of(task, trajectory, options.block);
  return bootstrap;
}

}  // namespace

void measure(TaskResult& result, const Trajectory& trajectory, const EvaluationOptions& options,
             const std::function<bool()>& stop) {
  const Task& task = result.task;
  result.labels = label_matches(result.matches, task, trajectory, task.rule);
  result.curve = precision_recall(result.labels, task.rejected_only);
  result.summary = summarize(result.labels, task.rejected_only);
  if (options.resamples == 0) return;
  const BootstrapOptions resamples = resampling(task, trajectory, options, stop);
  result.intervals = bootstrap(result.labels, task.rejected_only, resamples);
  std::tie(result.n_blocks, result.n_positive_blocks) =
      count_blocks(resamples, [&](size_t query) { return result.labels[query].positive; });
}

std::vector<bool> TaskResult::accepted() const {
  std::vector<bool> accepted;
  for (const Match& match : matches)
    accepted.push_back(match.score >= summary.f1_max_threshold);  // false for NaN
  return accepted;
}

double relative_yaw_deg(const Match& match, const std::vector<AlignmentRecord>& alignments) {
  if (match.relative_yaw) return *match.relative_yaw * 180.0 / std::numbers::pi;
  // A direction appears at both yaws: the headings differ by match - query. Case 2 looks backwards.
  const double query = alignments[static_cast<size_t>(match.query)].yaw;
  const double stored = alignments[static_cast<size_t>(match.ranks.at(0))].yaw;
  const double turned = match.which_case == 2 ? 180.0 : 0.0;
  return std::remainder((stored - query) * 180.0 / std::numbers::pi + turned, 360.0);
}

std::vector<Task> evaluation_tasks(const EvaluationOptions& options, const std::string& sequence,
                                   const Trajectory& trajectory) {
  std::vector<Task> tasks;
  for (const std::string& protocol : options.protocols)
    for (Task& task : make_tasks(protocol, sequence, trajectory, options.exclusion)) {
      if (options.distance) task.rule.distance = *options.distance;
      if (options.radius) task.rule.radius = *options.radius;
      if (options.negative_radius) task.rule.negative_radius = *options.negative_radius;
      if (options.negative_radius && *options.negative_radius < task.rule.radius)
        throw UsageError("negative radius: task ", task.name, ": expected at least the radius, ",
                         task.rule.radius, " m, found ", *options.negative_radius);
      if (options.query_case) task.both_cases = options.query_case == QueryCase::kBoth;
      need_distances(trajectory, task.rule.distance, "task " + task.name);
      if (std::ranges::find(tasks, task.name, &Task::name) != tasks.end())
        throw UsageError("task ", task.name, " is chosen twice");
      tasks.push_back(std::move(task));
    }
  if (tasks.empty()) throw UsageError("no protocol is chosen: give at least one");
  return tasks;
}

Evaluation::Evaluation(const Dataset& dataset, const FeatureExtractor& extractor,
                       const Trajectory& trajectory, std::vector<Task> tasks,
                       EvaluationOptions options, Observer observer)
    : trajectory_(trajectory),
      tasks_(std::move(tasks)),
      options_(std::move(options)),
      observer_(std::move(observer)),
      case1_(dataset, extractor, options_.describe, options_.cache, observer_),
      case2_(dataset, extractor, in_case(options_.describe, AlignCase::kTwo), options_.cache,
             observer_) {
  for (const Task& task : tasks_) check_query_case(options_, task);
}

std::string Evaluation::key() const {
  std::string text = str("evaluation ", kEvaluationVersion, "\n", case1_.key(), "poses");
  for (const Eigen::Vector3d& p : trajectory_.positions)
    text += str(" ", exact(p.x()), ",", exact(p.y()), ",", exact(p.z()));
  text += "\ntimes";
  for (const double time : trajectory_.times) text += " " + exact(time);
  if (trajectory_.listed) text += "\n" + trajectory_.listed->text();
  return text;
}

std::vector<std::filesystem::path> Evaluation::feature_files() const {
  std::vector<std::filesystem::path> files{case1_.path()};
  if (needs_case2()) files.push_back(case2_.path());
  return files;
}

bool Evaluation::needs_case2() const {
  return std::ranges::any_of(
      tasks_, [&](const Task& task) { return query_case_of(task) != QueryCase::kAsStored; });
}

QueryCase Evaluation::query_case_of(const Task& task) const {
  if (options_.describe.align != AlignCase::kOne) return QueryCase::kAsStored;
  if (options_.query_case == QueryCase::kTwo) return QueryCase::kTwo;
  return task.both_cases ? QueryCase::kBoth : QueryCase::kAsStored;
}

void Evaluation::note_once(const std::string& text) {
  if (said_.insert(text).second) observer_.note(text);
}

EvaluationResult Evaluation::run() {
  DatasetFeatures* case2 = needs_case2() ? &case2_ : nullptr;
  EvaluationResult result;
  result.skipped = skipped_rows(case1_, case2);
  for (Task& task : tasks_) {
    if (!result.skipped.empty()) remove_scans(task, result.skipped);
    auto lap = stopwatch();
    const Descriptors& descriptors = descriptors_of(task, case2);
    result.reduce_ms.push_back(lap());
    result.tasks.push_back(evaluate(task, descriptors, result));
    result.tasks.back().n_skipped = static_cast<int64_t>(result.skipped.size());
  }
  result.alignments = case1_.alignments();
  result.describe_times = case1_.times();
  if (case2) result.describe_times.append(case2->times());
  return result;
}

const Descriptors& Evaluation::descriptors_of(const Task& task, DatasetFeatures* case2) {
  if (!descriptors_ || (options_.reduction.fit_on == "map" && task.stored != stored_)) {
    descriptors_ = cached_or_reduced(options_.reduction, task, case1_, case2, observer_,
                                     options_.keep_descriptors ? options_.cache : "");
    stored_ = task.stored;
  }
  return *descriptors_;
}

TaskResult Evaluation::evaluate(const Task& task, const Descriptors& descriptors,
                                EvaluationResult& whole) {
  if (!descriptors.note.empty()) note_once(descriptors.note);
  const Progress progress =
      observer_.stage(task.decides_on_pairs ? "comparing" : "retrieving", "queries");
  auto lap = stopwatch();
  TaskResult result;
  if (task.decides_on_pairs) {
    BootstrapOptions options = resampling(task, trajectory_, options_, observer_.stop);
    options.progress = progress;
    result = evaluate_pairs(task, trajectory_, descriptors, options);
  }
  result.task = task;
  result.pca_fit = descriptors.pca_fit;
  result.descriptor_dim = descriptors.case1.d;
  const QueryCase query_case = query_case_of(task);
  result.query_case = query_case == QueryCase::kBoth  ? "both"
                      : query_case == QueryCase::kTwo ? "case2"
                                                      : name_of(options_.describe.align);
  if (task.both_cases && query_case != QueryCase::kBoth)
    note_once(str(task.name, " compares queries in both alignment cases, which needs ",
                  "features of case1; here it uses one case"));
  if (task.decides_on_pairs) {
    whole.retrieve_ms.push_back(lap());
    return result;
  }
  result.score = options_.score.value_or(
      case1_.extractor().similarity_is_probability || !task.margin_score ? Score::kSimilarity
                                                                         : Score::kMargin);
  result.matches =
      retrieve(descriptors, task,
               {options_.k, result.score, options_.threads, progress, observer_.stop}, query_case);
  whole.retrieve_ms.push_back(lap());
  measure(result, trajectory_, options_, observer_.stop);
  return result;
}

}  // namespace revisit
