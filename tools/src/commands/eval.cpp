#include <algorithm>
#include <iostream>

#include "cli/command.h"
#include "cli/json.h"
#include "cli/shell.h"
#include "cli/table.h"
#include "eval/plan.h"
#include "eval/print_results.h"
#include "eval/run_folder.h"
#include "report/report.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

void write_page(const fs::path& folder, const std::string& command) {
  PageOptions options;
  options.command = command;
  write_report({folder}, folder / "report.html", options);
}

/// run.json without its arrays of scans and queries.
void print_json(const FinishedEvaluation& evaluation) {
  reports::Run run, brief;
  read_report(evaluation.run / "run.json", &run);
  brief.set_folder(evaluation.run.string());
  *brief.mutable_info() = run.info();
  brief.mutable_info()->clear_key();
  *brief.mutable_configuration() = run.configuration();
  for (const reports::RunTask& task : run.tasks())
    *brief.add_tasks()->mutable_metrics() = task.metrics();
  std::cout << to_json(brief) << "\n";
}

void print_table(const FinishedEvaluation& evaluation, const EvalOptions& options) {
  const TaskResult& first = evaluation.result.tasks.front();
  std::cout << "feature " << evaluation.feature << " (" << evaluation.feature_dim
            << " dimensions), " << evaluation.trajectory.size() << " scans, "
            << (evaluation.reduced ? "PCA fitted on " + first.pca_fit : "no PCA");
  if (const auto speed = frames_per_second(evaluation.result.describe_times))
    std::cout << ", " << number(*speed, 1) << " scans/s per thread";
  std::cout << "\n\n";
  print_results(std::cout, evaluation, options.resamples());
  std::cout << "\n";
  print_times(evaluation.result, std::cout);
  std::cout << "\nresults: " << evaluation.run.string() << "\n";
  if (!options.no_report)
    std::cout << "report: " << (evaluation.run / "report.html").string() << "\n";
}

int run_evaluation(const EvalOptions& options) {
  const FinishedEvaluation evaluation = evaluate(options);
  if (!options.no_report) {
    const std::string run = evaluation.run.string();
    write_page(run, shell_command("revisit report", {run, "-o", run + "/report.html"}));
  }
  if (options.format == "json")
    print_json(evaluation);
  else
    print_table(evaluation, options);
  return evaluation.skipped.empty() ? kOk : kScansSkipped;
}

int run_plan(const EvalOptions& options, const Arguments& arguments) {
  const fs::path page = options.output / "report.html";
  if (!options.no_report) need_report(page, kHtmlMark, "move it away, or give --no-report");
  const std::string command = shell_command("revisit eval", arguments);
  const Experiments experiments = carry_out_plan(options, command);
  bool good = true;
  for (const reports::Experiment& experiment : experiments) {
    print_experiment(experiment, std::cout);
    good &= std::ranges::count(experiment.runs(), "failed", &reports::ExperimentRun::state) == 0;
  }
  std::cout << "\nresults: " << options.output.string() << "\n";
  if (!options.no_report) {
    write_page(options.output, command);
    std::cout << "report: " << page.string() << "\n";
  }
  return good ? kOk : kFailed;
}

int run_ground_truth(const EvalOptions& options) {
  std::cout << write_ground_truth(options) << "\nground truth: " << options.ground_truth.string()
            << "\n";
  return kOk;
}

int run_descriptors(const EvalOptions& options) {
  const DescribedScans described = write_descriptors(options);
  std::cout << described.n << " scans, feature " << described.feature << " ("
            << described.feature_dim << " dimensions), PCA " << described.pca_fit << "\n"
            << "descriptors: " << (options.descriptors / "descriptors.npy").string() << "\n";
  print_skipped(std::cout, described.skipped, described.n);
  std::cout << "\n";
  print_times(described.result, std::cout);
  return described.skipped.empty() ? kOk : kScansSkipped;
}

int run_eval(const EvalOptions& given, const Options& options) {
  if (!given.plan.empty()) return run_plan(given, options.arguments());
  if (!given.ground_truth.empty()) return run_ground_truth(given);
  if (!given.descriptors.empty()) return run_descriptors(given);
  return run_evaluation(given);
}

}  // namespace

Command eval_command() {
  return {
      "eval", "evaluate against ground truth: precision, recall, plots",
      "Evaluates place recognition against ground truth: describes every scan, retrieves matches, "
      "and reports precision and recall. By default each scan is a query against the scans before "
      "it, as `revisit loops` drives. DATA is a KITTI odometry folder (`revisit simulate` writes "
      "such), or any recording with --poses or --pairs. Of a --protocol, --perturb or --plan, an "
      "interrupted command resumes if it is run again.",
      "  revisit eval KITTI --sequence 00                              # ring descriptors\n"
      "  revisit eval KITTI --sequence 00 --keyframes meters=1 --score distinct-margin\n"
      "  revisit eval KITTI --sequence 05 --protocol online --radius 4 --exclusion seconds=30\n"
      "  revisit eval KITTI --sequence 00 --model bvlc_alexnet --end conv3+pool5 "
      "--protocol paper\n"
      "  revisit eval KITTI --sequence 00 --feature scan-context --perturb standard\n"
      "  revisit eval laps --pairs loops.csv,near=2\n"
      "  revisit eval KITTI --plan paper --model MODELS -o results/paper\n"
      "  revisit eval scans/ --feature data --pca 100 --descriptors out\n",
      with_options<EvalOptions>(run_eval)};
}

}  // namespace revisit::cli
