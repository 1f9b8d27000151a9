#include "experiment/run_experiments.h"

#include <algorithm>
#include <functional>
#include <iostream>
#include <map>

#include "cli/interrupt.h"
#include "cli/json.h"
#include "cli/messages.h"
#include "eval/evaluation.h"
#include "eval/run_folder.h"
#include "eval/run_times.h"
#include "revisit/base/atomic_file.h"
#include "revisit/base/folder.h"
#include "revisit/base/text.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// An evaluation that one or more experiments need.
struct Work {
  EvalOptions options;
  EvaluationKey key;
  std::string state = "to do", reason;
  reports::ExperimentRun result;  // but for panel and label
};

/// Runs finished earlier: `folder/HASH.json` has the result and what it depends on.
class FinishedRuns {
 public:
  explicit FinishedRuns(fs::path folder) : folder_(std::move(folder)) { make_folder(folder_); }
  bool find(const std::string& key, reports::ExperimentRun* result) const {
    const fs::path file = path(key);
    std::error_code none;
    if (!fs::exists(file, none)) return false;
    try {
      read_report(file, result);
    } catch (const InputError&) {
      return false;  // of another version: computed again
    }
    return result->key() == key && fs::exists(fs::path(result->folder()) / "report.json", none);
  }
  void add(const std::string& key, reports::ExperimentRun result) const {
    result.set_key(key);
    write_atomically(path(key), [&](std::ostream& out) { out << to_json(result) << "\n"; });
  }

 private:
  fs::path path(const std::string& key) const { return folder_ / (short_name_of(key) + ".json"); }
  fs::path folder_;
};

reports::ExperimentRun result_of(const EvalOptions& options, const FinishedEvaluation& evaluation) {
  reports::ExperimentRun run;
  run.set_state("done");
  run.set_folder(fs::absolute(evaluation.run).string());
  run.set_command(command_of(options));
  run.set_trained(evaluation.trained);
  run.set_feature_dimension(static_cast<double>(evaluation.feature_dim));
  run.set_descriptor_dimension(static_cast<int>(evaluation.result.tasks.front().descriptor_dim));
  if (const auto speed = frames_per_second(evaluation.result.times.describe))
    run.set_frames_per_second(*speed);
  const reports::MetricsList metrics = metrics_list(evaluation.result.tasks, options.resamples);
  *run.mutable_metrics() = metrics.tasks(0);
  return run;
}

/// The evaluations of all plans, each once, by their arguments.
class Workload {
 public:
  Workload(const ExperimentOptions& options, const std::vector<ExperimentPlan>& plans)
      : options_(options), finished_(options.output / "runs" / "finished") {
    for (const ExperimentPlan& plan : plans)
      for (const PlannedRun& run : plan.runs)
        if (run.skipped.empty()) prepare(run.arguments);
  }

  const Work& of(const Arguments& arguments) const { return works_.at(arguments); }

  int64_t count(const std::string& state) const {
    return std::count_if(works_.begin(), works_.end(),
                         [&](const auto& entry) { return entry.second.state == state; });
  }

  /// Does all runs; those of one feature follow each other.
  void run() {
    std::vector<Work*> to_do;
    for (const Arguments& arguments : order_)
      if (works_.at(arguments).state == "to do") to_do.push_back(&works_.at(arguments));
    std::map<fs::path, size_t> first_use, last_use;
    for (size_t i = 0; i < to_do.size(); ++i) first_use.try_emplace(to_do[i]->key.feature, i);
    std::stable_sort(to_do.begin(), to_do.end(), [&](const Work* a, const Work* b) {
      const auto rank = [&](const Work* work) {
        return std::pair(first_use.at(work->key.feature),
                         work->options.feature.components().value_or(-1) != 0);
      };
      return rank(a) < rank(b);
    });
    for (size_t i = 0; i < to_do.size(); ++i)
      for (const fs::path& file : to_do[i]->key.large_files) last_use[file] = i;
    for (size_t i = 0; i < to_do.size(); ++i) {
      if (interrupted()) throw Interrupted("stopped between two runs");
      if (!options_.quiet)
        std::cerr << "run " << i + 1 << "/" << to_do.size() << ": " << command_of(to_do[i]->options)
                  << "\n";
      run_one(*to_do[i]);
      if (options_.keep_features) continue;
      for (const fs::path& file : to_do[i]->key.large_files)
        if (last_use.at(file) == i) release(file);
    }
  }

 private:
  void prepare(const Arguments& arguments) {
    if (works_.count(arguments)) return;
    order_.push_back(arguments);
    Work& work = works_[arguments];
    try {
      work.options = complete(arguments);
      work.key = evaluation_key(work.options);
    } catch (const Interrupted&) {
      throw;
    } catch (const Error& error) {
      work.state = "skipped";
      work.reason = message_of(error);
      return;
    }
    if (finished_.find(work.key.text, &work.result)) work.state = "done";
  }

  /// Where things go is the same for all runs, and does not belong in their commands.
  EvalOptions complete(const Arguments& arguments) const {
    EvalOptions eval = parse_eval_options(arguments);
    eval.output = options_.output / "runs";
    eval.feature.cache = (options_.output / "cache").string();
    eval.feature.threads = options_.threads;
    eval.feature.no_progress = options_.no_progress;
    eval.feature.quiet = options_.quiet;
    return eval;
  }

  void run_one(Work& work) {
    try {
      work.result = result_of(work.options, evaluate(work.options));
      finished_.add(work.key.text, work.result);
      work.state = "done";
    } catch (const Interrupted&) {
      throw;
    } catch (const Error& error) {
      work.state = "failed";
      work.reason = message_of(error);
      std::cerr << "failed: " << work.reason << "\n";
    }
  }

  static void release(const fs::path& features) {
    std::error_code ignored;
    fs::remove(features, ignored);
    fs::remove(fs::path(features.string() + ".key"), ignored);
  }

  const ExperimentOptions& options_;
  FinishedRuns finished_;
  std::map<Arguments, Work> works_;
  std::vector<Arguments> order_;
};

/// Whether the interval of `metrics` has `average_precision` in it.
bool is_within(double average_precision, const reports::Metrics& metrics) {
  const auto& interval = metrics.average_precision_ci();
  return interval.size() == 2 && interval[0] <= average_precision &&
         average_precision <= interval[1];
}

reports::Experiment report_of(const ExperimentPlan& plan, const Workload& workload,
                              const Inventory& inventory, const fs::path& folder,
                              const std::string& command) {
  reports::Experiment experiment;
  experiment.set_name(plan.info->name);
  experiment.set_title(plan.info->title);
  experiment.set_question(plan.info->question);
  experiment.set_paper(plan.info->paper);
  experiment.set_version(REVISIT_VERSION);
  experiment.set_command(command);
  experiment.set_simulated(inventory.along_poses + inventory.along_routes > 0);
  for (const std::string& note : plan.notes) experiment.add_notes(note);
  for (const PlannedRun& planned : plan.runs) {
    reports::ExperimentRun& run = *experiment.add_runs();
    if (planned.skipped.empty()) {
      const Work& work = workload.of(planned.arguments);
      run = work.result;
      run.set_state(work.state);
      run.set_reason(work.reason);
      run.clear_key();
      if (!run.folder().empty()) run.set_folder(fs::relative(run.folder(), folder).string());
    } else {
      run.set_state("skipped");
      run.set_reason(planned.skipped);
    }
    run.set_panel(planned.panel);
    run.set_label(planned.curve.label);
    run.set_feature(planned.curve.feature);
    if (!planned.curve.parameters) continue;
    reports::Method& method = *run.mutable_method();
    method.set_needs_training(planned.curve.needs_training);
    method.set_parameters(*planned.curve.parameters);
    if (const auto speed = planned.curve.paper_frames_per_second)
      method.set_paper_frames_per_second(*speed);
  }
  check_claims(plan, &experiment);
  return experiment;
}

}  // namespace

void check_claims(const ExperimentPlan& plan, reports::Experiment* experiment) {
  const auto find = [&](const std::string& panel,
                        const std::string& label) -> const reports::ExperimentRun* {
    for (const reports::ExperimentRun& run : experiment->runs())
      if (run.panel() == panel && run.label() == label && run.state() == "done" && run.trained() &&
          run.metrics().has_average_precision())
        return &run;
    return nullptr;
  };
  std::vector<std::string> panels;
  for (const PlannedRun& run : plan.runs)
    if (std::find(panels.begin(), panels.end(), run.panel) == panels.end())
      panels.push_back(run.panel);
  for (const Claim& claim : plan.claims)
    for (const std::string& panel : panels) {
      const auto *better = find(panel, claim.better), *worse = find(panel, claim.worse);
      if (!better || !worse) continue;
      reports::ExperimentClaim& checked = *experiment->add_claims();
      checked.set_text(claim.text);
      checked.set_panel(panel);
      checked.set_better(claim.better);
      checked.set_worse(claim.worse);
      checked.set_better_average_precision(better->metrics().average_precision());
      checked.set_worse_average_precision(worse->metrics().average_precision());
      checked.set_holds(checked.better_average_precision() >=
                        checked.worse_average_precision() - claim.slack);
      // That two are as good as each other is all that such intervals can show.
      const bool as_claimed = claim.slack > 0 && checked.holds();
      checked.set_undecided(!as_claimed &&
                            is_within(checked.better_average_precision(), worse->metrics()) &&
                            is_within(checked.worse_average_precision(), better->metrics()));
    }
}

std::vector<reports::Experiment> run_experiments(const ExperimentOptions& options,
                                                 const Inventory& inventory,
                                                 std::vector<ExperimentPlan> plans,
                                                 const std::string& command) {
  Workload workload(options, plans);
  int64_t cannot_run = workload.count("skipped");
  for (const ExperimentPlan& plan : plans)
    cannot_run += std::ranges::count_if(plan.runs,
                                        [](const PlannedRun& run) { return !run.skipped.empty(); });
  if (!options.quiet)
    std::cerr << workload.count("to do") << " runs to do, " << workload.count("done")
              << " done before, " << cannot_run << " cannot run\n";
  std::vector<reports::Experiment> reports;
  const auto write = [&] {
    reports.clear();
    for (const ExperimentPlan& plan : plans) {
      const fs::path folder = fs::absolute(options.output / plan.info->name);
      make_folder(folder);
      reports.push_back(report_of(plan, workload, inventory, folder, command));
      write_atomically(folder / "experiment.json",
                       [&](std::ostream& out) { out << to_json(reports.back()) << "\n"; });
    }
  };
  try {
    workload.run();
  } catch (const Interrupted& stopped) {
    write();
    throw Interrupted(
        str(stopped.what(), "; finished runs are kept: run the same command again to continue"));
  }
  write();
  return reports;
}

}  // namespace revisit::cli
