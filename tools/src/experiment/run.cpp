#include <algorithm>
#include <iostream>
#include <map>

#include "cli/interrupt.h"
#include "cli/json.h"
#include "cli/messages.h"
#include "eval/evaluation.h"
#include "eval/run_folder.h"
#include "eval/run_times.h"
#include "experiment/experiment.h"
#include "revisit/base/atomic_file.h"
#include "revisit/base/folder.h"
#include "revisit/base/text.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// An evaluation, which several experiments may need.
struct Work {
  EvalOptions options;
  EvaluationKey key;
  fs::path finished;              // the file that keeps the result
  reports::ExperimentRun result;  // but for panel and label
};

void write_json(const fs::path& file, const google::protobuf::Message& report) {
  make_folder(file.parent_path());
  write_atomically(file, [&](std::ostream& out) { out << to_json(report) << "\n"; });
}

/// Takes the result of a run that was finished earlier.
void find_finished(Work* work) {
  reports::ExperimentRun result;
  try {
    read_report(work->finished, &result);
  } catch (const InputError&) {
    return;  // absent, or of another version
  }
  if (result.key() == work->key.text && fs::exists(fs::path(result.folder()) / "report.json"))
    work->result = result;
}

/// Opens all that the evaluation needs. Where things go is the same for all runs, and does not
/// belong in their commands.
Work prepare(const Arguments& arguments, const ExperimentOptions& options) {
  Work work;
  work.result.set_state("to do");
  try {
    work.options = parse_eval_options(arguments);
    work.options.output = options.output / "runs";
    work.options.feature.cache = (options.output / "cache").string();
    work.options.feature.threads = options.shared.threads;
    work.options.feature.no_progress = options.shared.no_progress;
    work.options.feature.quiet = options.shared.quiet;
    work.key = evaluation_key(work.options);
    work.finished = options.output / "runs/finished" / (short_name_of(work.key.text) + ".json");
    const double megabytes = static_cast<double>(work.key.feature_dim) * sizeof(float) / 1e6;
    if (work.options.feature.feature == "cnn" && megabytes > options.feature_mb)
      throw UsageError(str(work.key.feature_dim, " numbers per scan are ",
                           static_cast<int>(megabytes), " MB; --feature-mb allows more"));
    find_finished(&work);
  } catch (const Interrupted&) {
    throw;
  } catch (const Error& error) {
    work.result.set_state("skipped");
    work.result.set_reason(message_of(error));
  }
  return work;
}

void run(Work* work) {
  reports::ExperimentRun& run = work->result;
  try {
    const FinishedEvaluation evaluation = evaluate(work->options);
    const std::vector<pipeline::TaskResult>& tasks = evaluation.result.tasks;
    run.set_state("done");
    run.set_folder(fs::absolute(evaluation.run).string());
    run.set_command(command_of(work->options));
    run.set_trained(evaluation.trained);
    run.set_feature_dimension(static_cast<double>(evaluation.feature_dim));
    run.set_descriptor_dimension(static_cast<int>(tasks.front().descriptor_dim));
    if (const auto speed = frames_per_second(evaluation.result.times.describe))
      run.set_frames_per_second(*speed);
    *run.mutable_metrics() = metrics_list(tasks, work->options.resamples).tasks(0);
    run.set_key(work->key.text);
    write_json(work->finished, run);
  } catch (const Interrupted&) {
    throw;
  } catch (const Error& error) {
    run.set_state("failed");
    run.set_reason(message_of(error));
    std::cerr << "failed: " << run.reason() << "\n";
  }
}

/// Does the runs that are to do; those of one feature follow each other, first the one whose PCA
/// serves the others. Large files go when the last of these is done.
void run_all(const ExperimentOptions& options, const std::vector<Work*>& to_do) {
  std::map<fs::path, std::vector<Work*>> by_feature;
  for (Work* work : to_do) by_feature[work->key.feature].push_back(work);
  size_t number = 0;
  for (auto& [feature, works] : by_feature) {
    std::ranges::stable_partition(
        works, [](const Work* work) { return work->options.feature.components() == 0; });
    for (Work* work : works) {
      if (interrupted()) throw Interrupted("stopped between two runs");
      if (!options.shared.quiet)
        std::cerr << "run " << ++number << "/" << to_do.size() << ": " << command_of(work->options)
                  << "\n";
      run(work);
    }
    if (options.keep_features) continue;
    for (const Work* work : works)
      for (const fs::path& file : work->key.large_files) {
        std::error_code ignored;
        fs::remove(file, ignored);
        fs::remove(file.string() + ".key", ignored);
      }
  }
}

/// Whether the interval of `metrics` has `average_precision` in it.
bool is_within(double average_precision, const reports::Metrics& metrics) {
  const auto& interval = metrics.average_precision_ci();
  return interval.size() == 2 && interval[0] <= average_precision &&
         average_precision <= interval[1];
}

}  // namespace

void check_claims(const std::vector<reports::PlannedClaim>& claims, reports::Experiment* report) {
  std::map<std::pair<std::string, std::string>, const reports::Metrics*> figures;  // panel, label
  std::vector<std::string> panels;
  for (const reports::ExperimentRun& run : report->runs()) {
    if (std::ranges::count(panels, run.panel()) == 0) panels.push_back(run.panel());
    if (run.state() == "done" && run.trained() && run.metrics().has_average_precision())
      figures[{run.panel(), run.label()}] = &run.metrics();
  }
  for (const reports::PlannedClaim& claim : claims)
    for (const std::string& panel : panels) {
      const auto better = figures.find({panel, claim.better()});
      const auto worse = figures.find({panel, claim.worse()});
      if (better == figures.end() || worse == figures.end()) continue;
      const double more = better->second->average_precision();
      const double less = worse->second->average_precision();
      reports::ExperimentClaim& checked = *report->add_claims();
      checked.set_text(claim.text());
      checked.set_panel(panel);
      checked.set_better(claim.better());
      checked.set_worse(claim.worse());
      checked.set_better_average_precision(more);
      checked.set_worse_average_precision(less);
      checked.set_holds(more >= less - claim.slack());
      // That two are as good as each other is all that such intervals can show.
      const bool as_claimed = claim.slack() > 0 && checked.holds();
      checked.set_undecided(!as_claimed && is_within(more, *worse->second) &&
                            is_within(less, *better->second));
    }
}

std::vector<reports::Experiment> run_plans(const ExperimentOptions& options,
                                           const std::vector<Plan>& plans,
                                           const std::string& command) {
  std::map<Arguments, Work> works;
  std::vector<Work*> to_do;
  std::map<std::string, int> count;  // by state
  for (const Plan& plan : plans)
    for (size_t i = 0; i < plan.arguments.size(); ++i) {
      if (plan.report.runs(static_cast<int>(i)).state() == "skipped") {
        ++count["skipped"];
        continue;
      }
      const auto [entry, is_new] = works.try_emplace(plan.arguments[i]);
      if (!is_new) continue;
      Work& work = entry->second = prepare(entry->first, options);
      ++count[work.result.state()];
      if (work.result.state() == "to do") to_do.push_back(&work);
    }
  if (!options.shared.quiet)
    std::cerr << count["to do"] << " runs to do, " << count["done"] << " done before, "
              << count["skipped"] << " cannot run\n";
  std::vector<reports::Experiment> reports;
  const auto write = [&] {
    for (const Plan& plan : plans) {
      const fs::path folder = fs::absolute(options.output / plan.report.name());
      reports::Experiment& report = reports.emplace_back(plan.report);
      report.set_command(command);
      for (size_t i = 0; i < plan.arguments.size(); ++i) {
        reports::ExperimentRun& run = *report.mutable_runs(static_cast<int>(i));
        if (run.state() == "skipped") continue;
        run.MergeFrom(works.at(plan.arguments[i]).result);
        run.clear_key();
        if (!run.folder().empty()) run.set_folder(fs::relative(run.folder(), folder).string());
      }
      check_claims(plan.claims, &report);
      write_json(folder / "experiment.json", report);
    }
  };
  try {
    run_all(options, to_do);
  } catch (const Interrupted& stopped) {
    write();
    throw Interrupted(
        str(stopped.what(), "; finished runs are kept: run the same command again to continue"));
  }
  write();
  return reports;
}

}  // namespace revisit::cli
