#include <algorithm>
#include <iostream>
#include <sstream>

#include "cli/command.h"
#include "cli/interrupt.h"
#include "cli/json.h"
#include "cli/progress.h"
#include "cli/table.h"
#include "eval/config_file.h"
#include "eval/descriptors.h"
#include "eval/figures.h"
#include "eval/run_folder.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

struct EvalOptions {
  FeatureOptions feature;
  fs::path output = "results";
  std::string protocol = "paper", format = "table";
  std::optional<std::string> score;  // absent: the feature's own way
  std::optional<std::string> distance, exclusion;
  std::optional<double> radius;
  int k = 4;
  bool no_plots = false;
};

/// Every option with the value it has, for config.yaml.
std::vector<std::pair<std::string, std::string>> settings_of(const EvalOptions& o) {
  const FeatureOptions& f = o.feature;
  return {{"sequence", f.sequence},
          {"sensor", f.sensor},
          {"width", f.width ? str(f.width) : ""},
          {"height", f.height ? str(f.height) : ""},
          {"max-range", f.max_range > 0 ? str(f.max_range) : ""},
          {"feature", f.feature},
          {"model", f.model.string()},
          {"weights", f.weights.string()},
          {"end", f.end},
          {"graft", f.graft},
          {"mean-bgr", f.mean_bgr},
          {"images", f.images.string()},
          {"training-images", f.training_images.string()},
          {"new-place", f.new_place},
          {"ring-key-candidates", str(f.ring_key_candidates)},
          {"pca", f.components ? str(*f.components) : ""},
          {"pca-fit", f.pca_fit},
          {"memory", str(f.memory_gb)},
          {"protocol", o.protocol},
          {"align", f.align.value_or("")},
          {"score", o.score.value_or("")},
          {"k", str(o.k)},
          {"distance", o.distance.value_or("")},
          {"exclusion", o.exclusion.value_or("")},
          {"radius", o.radius ? str(*o.radius) : ""}};
}

EvalOptions parse_options(const Arguments& arguments) {
  EvalOptions o;
  Parser parser("revisit eval", "DATA",
                "Place recognition with ground truth: describe every scan, retrieve, and measure "
                "precision and recall. "
                "DATA is a KITTI odometry folder (or one that `revisit simulate` wrote). A stopped "
                "run goes on where "
                "it was when the same command is given again.",
                "  revisit eval KITTI --sequence 00 --model alexnet.prototxt --weights "
                "bvlc_alexnet.caffemodel "
                "--end conv3 --graft pool5\n"
                "  revisit eval KITTI --sequence 08 --protocol paper-difficult\n"
                "  revisit eval KITTI --sequence 05 --protocol online --radius 5 --distance xz "
                "--exclusion frames=50\n"
                "  revisit eval KITTI --sequence 00 --feature data     # the range image itself, "
                "for comparison\n"
                "  revisit eval KITTI --sequence 00 --feature scan-context --threads 1\n");
  o.feature.declare(parser);
  parser.group("Evaluation:");
  parser.option(
      "protocol", "NAME[,NAME]",
      "paper, paper-easy, paper-median, paper-difficult, online, leave-one-out (default paper)",
      &o.protocol);
  parser.option("score", "margin|cosine",
                "s = 2 c1 - ck, or c1 alone (default margin; cosine, which then is their own "
                "similarity, for scan-context and fabmap)",
                &o.score);
  parser.option("k", "K", "retrieved scans a query (default 4)", &o.k);
  parser.option("distance", "xz|3d|box",
                "how the distance to a true match is measured (default: the protocol's)",
                &o.distance);
  parser.option("radius", "METRES", "a match nearer than this is true (default: the protocol's)",
                &o.radius);
  parser.option("exclusion", "KIND=N",
                "frames=50, seconds=30, metres=50 or none (online, leave-one-out)", &o.exclusion);
  parser.group("Output:");
  parser.option("output", "DIR", "results go to DIR/<data>_<sequence>/<time>/ (default results)",
                &o.output, 'o');
  parser.option("format", "table|json", "what is printed (default table)", &o.format);
  parser.flag("no-plots", "no figures", &o.no_plots);
  parser.config(read_config_file);
  parser.parse(arguments);
  if (o.format != "table" && o.format != "json")
    throw UsageError("--format: expected table or json, found '" + o.format + "'");
  if (o.radius && !(*o.radius > 0))
    throw UsageError(str("--radius: expected a positive number, found ", *o.radius));
  return o;
}

std::vector<pipeline::Task> tasks_for(const EvalOptions& o, const pipeline::Dataset& dataset,
                                      const pipeline::Trajectory& trajectory) {
  const pipeline::Exclusion exclusion =
      o.exclusion ? pipeline::parse_exclusion(*o.exclusion) : pipeline::Exclusion{};
  std::vector<pipeline::Task> tasks;
  std::istringstream names(o.protocol);
  for (std::string name; std::getline(names, name, ',');)
    for (pipeline::Task& task :
         pipeline::make_tasks(name, dataset.sequence, trajectory, exclusion)) {
      if (o.distance) task.rule.distance = pipeline::parse_distance(*o.distance);
      if (o.radius) task.rule.radius = *o.radius;
      tasks.push_back(std::move(task));
    }
  if (tasks.empty()) throw UsageError("--protocol: give at least one name");
  return tasks;
}

/// How sure a match is, by default: the features that are compared in their own way say it
/// themselves.
pipeline::Score score_for(const EvalOptions& o, const FeatureSource& source) {
  if (o.score) return pipeline::parse_score(*o.score);
  return source.extractor.similarity ? pipeline::Score::kBest : pipeline::Score::kMargin;
}

TaskResult run_task(const EvalOptions& o, const FeatureSource& source, const pipeline::Task& task,
                    const pipeline::Trajectory& trajectory, const Features& case1,
                    const Features* case2) {
  TaskResult result;
  result.task = task;
  result.rule = task.rule;
  const Descriptors descriptors =
      reduce(o.feature, source.components, task, case1, task.both_cases ? case2 : nullptr);
  if (!descriptors.note.empty() && !o.feature.quiet)
    std::cerr << "note: " << descriptors.note << "\n";
  result.pca_fit = descriptors.pca_fit;

  Progress progress("retrieving", "queries", !o.feature.no_progress && !o.feature.quiet);
  const pipeline::RetrieveOptions retrieve{
      o.k,         score_for(o, source),        progress.callback(),
      interrupted, source.extractor.similarity, o.feature.thread_count()};
  result.matches = pipeline::retrieve(descriptors.case1, task, retrieve,
                                      descriptors.case2 ? &*descriptors.case2 : nullptr);
  result.verdicts = pipeline::judge(result.matches, task, trajectory, task.rule);
  result.curve = pipeline::precision_recall(result.verdicts);
  result.summary = pipeline::summarize(result.verdicts);
  return result;
}

void print_summary(const std::vector<TaskResult>& results) {
  Table table({"task", "stored", "queries", "with a true match", "AP", "F1 max", "recall@100%P",
               "recall@1"});
  for (const TaskResult& r : results)
    table.row({r.task.name, str(r.task.stored.size()), str(r.summary.n_queries),
               str(r.summary.n_positives), number(r.summary.average_precision, 4),
               number(r.summary.f1_max, 4), number(r.summary.max_recall_at_precision_1, 4),
               number(r.summary.recall_at_1, 4)});
  table.print(std::cout);
}

/// For a handful of queries: what each of them found.
void print_matches(const TaskResult& result, const pipeline::Trajectory& trajectory,
                   const std::string& similarity) {
  constexpr size_t kHandful = 20;
  if (result.matches.size() > kHandful) return;
  const auto frame = [&](int64_t scan) {
    return str(trajectory.frames[static_cast<size_t>(scan)]);
  };
  Table table({"query", "best", similarity, "next", similarity + " of next", "score",
               "metres to best", "true"});
  for (size_t q = 0; q < result.matches.size(); ++q) {
    const pipeline::Match& m = result.matches[q];
    const auto position = [&](int64_t scan) {
      return trajectory.positions[static_cast<size_t>(scan)];
    };
    const bool has_next = m.ranks.size() > 1;
    table.row({frame(m.query), frame(m.ranks[0]), number(m.similarities[0], 3),
               has_next ? frame(m.ranks[1]) : "", has_next ? number(m.similarities[1], 3) : "",
               number(m.score, 3),
               number(pipeline::distance_between(position(m.query), position(m.ranks[0]),
                                                 result.rule.distance),
                      1),
               result.verdicts[q].correct    ? "yes"
               : result.verdicts[q].positive ? "no, there was one"
                                             : "none there"});
  }
  std::cout << "\n" << result.task.name << ":\n";
  table.print(std::cout);
}

}  // namespace

int eval_command(const Arguments& arguments) {
  const EvalOptions o = parse_options(arguments);
  if (o.score) pipeline::parse_score(*o.score);
  const pipeline::Dataset dataset =
      pipeline::open_dataset(o.feature.data, o.feature.sequence, {.poses = true});
  const pipeline::Trajectory trajectory = pipeline::make_trajectory(dataset);
  const std::vector<pipeline::Task> tasks = tasks_for(o, dataset, trajectory);
  const fs::path cache = o.feature.cache_folder(o.output);
  const FeatureSource source = open_feature(o.feature, dataset, cache);

  pipeline::DescribeTimes times;
  const Features case1 = compute_features(o.feature, source, source.align, cache, &times);
  const bool need_case2 =
      std::any_of(tasks.begin(), tasks.end(), [](const auto& task) { return task.both_cases; });
  std::optional<Features> case2;
  if (need_case2 && source.align == pipeline::AlignMode::kCase1)
    case2 = compute_features(o.feature, source, pipeline::AlignMode::kCase2, cache, &times);

  std::vector<TaskResult> results;
  for (const pipeline::Task& task : tasks)
    results.push_back(run_task(o, source, task, trajectory, case1, case2 ? &*case2 : nullptr));

  const fs::path run = make_run_folder(o.output, dataset);
  const RunContext context{o.feature,        dataset,        trajectory, source,
                           case1.alignments, settings_of(o), o.k};
  write_run(run, context, results, times);
  if (!o.no_plots) write_figures(run, context, results, source.align);
  link_latest(run);

  if (o.format == "json") {
    reports::MetricsList metrics = metrics_list(results);
    metrics.set_folder(run.string());
    std::cout << to_json(metrics) << "\n";
    return kOk;
  }
  std::cout << "feature " << source.extractor.name << " (" << source.extractor.dim
            << " numbers a scan), " << dataset.scans.size() << " scans, "
            << (source.components < 0 ? "no PCA" : "PCA fitted on " + results.front().pca_fit);
  if (const auto speed = frames_per_second(times))
    std::cout << ", " << number(*speed, 1) << " scans/s a thread";
  std::cout << "\n\n";
  print_summary(results);
  for (const TaskResult& result : results)
    print_matches(result, trajectory, similarity_name(source));
  if (source.model && !source.model->trained)
    std::cout << "\nThe network is UNTRAINED (random weights): these figures say nothing about the "
                 "method.\n";
  std::cout << "\nresults: " << run.string() << "\n";
  return kOk;
}

}  // namespace revisit::cli
