#include <algorithm>
#include <cmath>
#include <iostream>
#include <map>

#include "cli/command.h"
#include "cli/json.h"
#include "cli/shell.h"
#include "cli/terminal.h"
#include "eval/evaluation.h"
#include "eval/plan.h"
#include "eval/run_folder.h"
#include "report/report.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

std::string interval(const std::array<double, 2>& i) {
  return std::isnan(i[0]) ? "" : number(i[0], 3) + "-" + number(i[1], 3);
}

void print_loops(std::ostream& out, const AcceptedLoops& loops) {
  out << "accepted by default (score >= " << number(loops.threshold, 3) << "): " << loops.correct
      << " correct, " << loops.ignored << " ignored, " << loops.incorrect << " incorrect";
  if (loops.unlabeled > 0) out << ", " << loops.unlabeled << " without ground truth";
  out << "\n";
}

std::string fraction(int64_t part, int64_t whole) {
  return whole ? str(part, "/", whole) : "";
}

/// A row per perturbation.
void print_perturbed(std::ostream& out, const std::vector<TaskResult>& results) {
  Table table({"perturbation", "self", "neighbor", "recall@1", "AP", "ratio", "minimum"});
  for (const TaskResult& r : results)
    table.row({text_of(r.perturbed->perturbation), fraction(r.perturbed->self, r.summary.n_queries),
               fraction(r.perturbed->neighbor, r.summary.n_positives),
               number(r.summary.recall_at_1, 3), number(r.summary.average_precision, 3),
               number(r.perturbed->ratio_median, 2), number(r.perturbed->ratio_min, 2)});
  table.print(out);
  for (const TaskResult& r : results)
    if (r.perturbed->skipped > 0)
      out << text_of(r.perturbed->perturbation) << ": " << r.perturbed->skipped
          << " perturbed scans could not be described; they count as missed\n";
}

void print_summary(std::ostream& out, const std::vector<TaskResult>& results, int resamples) {
  Table table({"task", "database", "queries", "with a correct match", "AP", "F1 max",
               "recall@100%P", "recall@1", "EP"});
  for (const TaskResult& r : results) {
    const PrSummary& s = r.summary;
    table.row({r.task.name, str(r.task.stored.size()), str(s.n_queries), str(s.n_positives),
               number(s.average_precision, 4), number(s.f1_max, 4),
               number(s.max_recall_at_precision_1, 4), number(s.recall_at_1, 4),
               number(s.extended_precision, 4)});
    if (r.intervals)
      table.row({"  95 %", "", "", "", interval(r.intervals->average_precision),
                 interval(r.intervals->f1_max), interval(r.intervals->max_recall_at_precision_1),
                 interval(r.intervals->recall_at_1), interval(r.intervals->extended_precision)});
  }
  table.print(out);
  for (const TaskResult& r : results)
    if (r.task.decides_on_pairs)
      out << r.task.name << ": " << r.summary.n_pairs << " pairs, " << r.summary.n_correct_pairs
          << " of them correct\n";
  for (const TaskResult& r : results)
    if (r.loops) print_loops(out, *r.loops);
  if (resamples == 0 || results.empty()) return;
  out << "95 %: confidence intervals from " << resamples << " block resamples of the queries (";
  for (const TaskResult& r : results)
    out << (&r == results.data() ? "" : ", ") << r.n_blocks << (results.size() > 1 ? " of " : "")
        << (results.size() > 1 ? r.task.name : "");
  out << (results.size() > 1 ? ")\n" : " blocks)\n");
}

/// Prints nothing if `names` is empty.
void print_skipped(std::ostream& out, const std::vector<std::string>& names, int64_t n_scans) {
  if (names.empty()) return;
  constexpr size_t kFew = 5;
  out << names.size() << " of " << n_scans << " scans could not be described and were skipped: ";
  for (size_t i = 0; i < std::min(names.size(), kFew); ++i) out << (i ? ", " : "") << names[i];
  out << (names.size() > kFew ? ", ...\n" : "\n");
}

void print_results(std::ostream& out, const FinishedEvaluation& evaluation, int resamples) {
  const std::vector<TaskResult>& tasks = evaluation.result.tasks;
  if (tasks.front().perturbed)
    print_perturbed(out, tasks);
  else
    print_summary(out, tasks, resamples);
  print_skipped(out, evaluation.skipped, evaluation.trajectory.size());
  if (evaluation.source.model && !evaluation.source.model->trained)
    out << "\nThe network is UNTRAINED (random weights): results do not measure accuracy.\n";
}

std::string metric(bool there, double value) {
  return there ? number(value, 3) : "";
}

std::string metric(bool there, double value, const google::protobuf::RepeatedField<double>& ci) {
  std::string text = metric(there, value);
  if (there && ci.size() == 2) text += " [" + number(ci[0], 2) + ", " + number(ci[1], 2) + "]";
  return text;
}

std::vector<std::string> cells_of(const reports::ExperimentRun& run) {
  const reports::Metrics& m = run.metrics();
  return {run.panel(),
          run.label(),
          metric(m.has_average_precision(), m.average_precision(), m.average_precision_ci()),
          metric(m.has_f1_max(), m.f1_max(), m.f1_max_ci()),
          metric(m.has_max_recall_at_precision_1(), m.max_recall_at_precision_1()),
          metric(m.has_recall_at_1(), m.recall_at_1(), m.recall_at_1_ci())};
}

void write_claims(const reports::Experiment& experiment, std::ostream& out) {
  for (const reports::ExperimentClaim& claim : experiment.claims())
    out << "- " << claim.panel() << ": " << claim.text() << ": "
        << (claim.undecided() ? "undecided (each within the other's 95 % interval)"
            : claim.holds()   ? "holds"
                              : "does not hold")
        << " (AP of " << claim.better() << " " << number(claim.better_average_precision(), 3)
        << ", of " << claim.worse() << " " << number(claim.worse_average_precision(), 3) << ")\n";
  if (experiment.claims_size()) out << "\n";
}

void write_skipped(const reports::Experiment& experiment, std::ostream& out) {
  std::map<std::string, std::vector<std::string>> by_reason;
  for (const reports::ExperimentRun& run : experiment.runs())
    if (run.state() != "done") by_reason[run.reason()].push_back(run.panel() + " " + run.label());
  for (const auto& [reason, labels] : by_reason) {
    out << "Not run (" << reason << "): " << joined(labels, "; ") << ".\n\n";
  }
}

void print_experiment(const reports::Experiment& experiment, std::ostream& out) {
  out << "\n" << experiment.title() << "\n\n";
  for (const std::string& note : experiment.notes()) out << note << "\n";
  Table table({"sequence", "curve", "AP", "F1 max", "recall@100%P", "recall@1"});
  bool any = false;
  for (const reports::ExperimentRun& run : experiment.runs()) {
    if (run.state() != "done") continue;
    table.row(cells_of(run));
    any = true;
  }
  if (any) table.print(out);
  write_claims(experiment, out);
  write_skipped(experiment, out);
}

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
  const FeatureExtractor& feature = evaluation.source.extractor;
  std::cout << "feature " << feature.name << " (" << feature.dim << " dimensions), "
            << evaluation.trajectory.size() << " scans, "
            << (evaluation.source.components >= 0 ? "PCA fitted on " + first.pca_fit : "no PCA");
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
  if (!options.no_report) need_report(page, "move it away, or give --no-report");
  const std::string command = shell_command("revisit eval", arguments);
  const Experiments experiments = carry_out_plan(options, command);
  bool failed = false, done = false;
  for (const reports::Experiment& experiment : experiments) {
    print_experiment(experiment, std::cout);
    for (const reports::ExperimentRun& run : experiment.runs()) {
      failed |= run.state() == "failed";
      done |= run.state() == "done";
    }
  }
  std::cout << "\nresults: " << options.output.string() << "\n";
  if (!options.no_report) {
    write_page(options.output, command);
    std::cout << "report: " << page.string() << "\n";
  }
  if (!failed && !done)
    throw InputError("--plan ", options.plan, ": nothing was run, for the reasons above");
  return failed ? kFailed : kOk;
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
  return {"eval", "evaluate against ground truth: precision, recall, plots",
          "Evaluates place recognition against ground truth: describes every scan, retrieves "
          "matches, and reports precision and recall. By default each scan is a query against the "
          "scans before it, as `revisit loops` drives. DATA is a KITTI odometry folder (`revisit "
          "simulate` writes such), or any recording with --poses or --pairs. Of a --protocol, "
          "--perturb or --plan, an interrupted command resumes if it is run again.",
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
