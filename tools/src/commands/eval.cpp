#include <iostream>

#include "cli/json.h"
#include "cli/shell.h"
#include "cli/table.h"
#include "eval/evaluation.h"
#include "eval/run_folder.h"
#include "eval/run_times.h"
#include "eval/summary_table.h"
#include "report/page.h"

namespace revisit::cli {
namespace {

void print_matches(const TaskResult& result, const Trajectory& trajectory,
                   const std::string& similarity) {
  constexpr size_t kHandful = 20;
  if (result.on_pairs() || result.matches.size() > kHandful) return;
  const auto frame = [&](int64_t scan) {
    return str(trajectory.frames[static_cast<size_t>(scan)]);
  };
  const Distance kind = result.task.rule.distance;
  const auto meters = [&](const Match& m) {
    if (kind == Distance::kPairs) return std::string();
    return number(distance_between(trajectory, m.query, m.ranks[0], kind), 1);
  };
  Table table({"query", "best", similarity, "next", similarity + " of next", "score",
               "meters to best", "correct"});
  for (size_t q = 0; q < result.matches.size(); ++q) {
    const Match& m = result.matches[q];
    const bool has_next = m.ranks.size() > 1;
    table.row({frame(m.query), frame(m.ranks[0]), number(m.similarities[0], 3),
               has_next ? frame(m.ranks[1]) : "", has_next ? number(m.similarities[1], 3) : "",
               number(m.score, 3), meters(m),
               result.labels[q].correct    ? "yes"
               : result.labels[q].ignored  ? "ignored"
               : result.labels[q].positive ? "no (missed)"
                                           : "no (no true match)"});
  }
  std::cout << "\n" << result.task.name << ":\n";
  table.print(std::cout);
}

std::filesystem::path write_page(const std::filesystem::path& run) {
  const std::filesystem::path file = run / "report.html";
  PageOptions options;
  options.command = shell_command("revisit report", {run.string(), "-o", file.string()});
  write_report({run}, file, options);
  return file;
}

int run_eval(const EvalOptions& options) {
  const FinishedEvaluation evaluation = evaluate(options);
  const int exit_code = evaluation.skipped.empty() ? kOk : kScansSkipped;
  if (options.format == "json") {
    if (!options.no_report) write_page(evaluation.run);
    reports::MetricsList metrics = metrics_list(evaluation.result.tasks, options.resamples);
    metrics.set_folder(evaluation.run.string());
    std::cout << to_json(metrics) << "\n";
    return exit_code;
  }
  std::cout << "feature " << evaluation.feature << " (" << evaluation.feature_dim
            << " dimensions), " << evaluation.trajectory.size() << " scans, "
            << (evaluation.reduced ? "PCA fitted on " + evaluation.result.tasks.front().pca_fit
                                   : "no PCA");
  if (const auto speed = frames_per_second(evaluation.result.times.describe))
    std::cout << ", " << number(*speed, 1) << " scans/s per thread";
  std::cout << "\n\n";
  print_summary(std::cout, evaluation.result.tasks, options.resamples);
  print_skipped(std::cout, evaluation.skipped, evaluation.trajectory.size());
  for (const TaskResult& result : evaluation.result.tasks)
    print_matches(result, evaluation.trajectory, evaluation.similarity);
  if (!evaluation.trained)
    std::cout << "\nThe network is UNTRAINED (random weights): results do not measure accuracy.\n";
  std::cout << "\n";
  print_times(evaluation.result.times, std::cout);
  std::cout << "\nresults: " << evaluation.run.string() << "\n";
  if (!options.no_report) std::cout << "report: " << write_page(evaluation.run).string() << "\n";
  return exit_code;
}

}  // namespace

Command eval_command() {
  return {
      "eval", "evaluate against ground truth: precision, recall, plots",
      "Evaluates place recognition against ground truth: describes every scan, retrieves matches, "
      "and reports precision and recall. DATA is a KITTI odometry folder (`revisit simulate` "
      "writes such), or any recording with --poses or --pairs. If interrupted, run the same "
      "command again to resume.",
      "  revisit eval KITTI --sequence 00                              # ring descriptors\n"
      "  revisit eval KITTI --sequence 00 --causal --keyframes meters=1   # as `revisit loops` "
      "runs\n"
      "  revisit eval KITTI --sequence 05 --radius 4 --exclusion seconds=30\n"
      "  revisit eval KITTI --sequence 00 --model bvlc_alexnet --end conv3 --graft pool5 "
      "--protocol paper\n"
      "  revisit eval KITTI --sequence 00 --feature scan-context --threads 1\n"
      "  revisit eval laps --causal --pairs loops.csv --pairs-near 2\n",
      with_options<EvalOptions>(run_eval)};
}

}  // namespace revisit::cli
