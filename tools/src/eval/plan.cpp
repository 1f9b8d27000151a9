#include "eval/plan.h"

#include <google/protobuf/text_format.h>

#include <algorithm>
#include <iostream>
#include <iterator>
#include <set>
#include <sstream>

#include "cli/json.h"
#include "cli/terminal.h"
#include "eval/evaluation.h"
#include "eval/run_folder.h"
#include "paper_plan.h"
#include "revisit/base/files.h"
#include "revisit/base/hash.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

void add(const Arguments& more, Arguments* arguments) {
  arguments->insert(arguments->end(), more.begin(), more.end());
}

struct Feature {
  std::string name;    // with its layers; "" without a network
  std::string prefix;  // of the labels of its curves
  Arguments arguments;
};

/// All features of each network, or the best one of each trained network (of the first network if
/// none is trained).
std::vector<Feature> features_of(const std::vector<models::FoundModel>& networks, bool all) {
  std::vector<Feature> features;
  for (const models::FoundModel& network : networks) {
    if (!all && !network.trained && !features.empty()) break;
    for (const std::string& cut : all ? models::cuts_of(network) : std::vector{network.cut}) {
      Feature& feature = features.emplace_back();
      feature.name = network.name + " " + cut;
      if (!network.trained) feature.name += " (UNTRAINED)";
      feature.arguments = {"--feature",      "cnn",       "--model",
                           network.prototxt, "--weights", network.weights};
      add({"--end", cut}, &feature.arguments);
    }
  }
  for (Feature& feature : features)
    feature.prefix = all ? feature.name : features.size() > 1 ? feature.name + ", " : "";
  return features;
}

Experiments parse_plan(const std::string& text, const std::string& name) {
  reports::Plan plan;
  if (!google::protobuf::TextFormat::ParseFromString(text, &plan) || plan.experiment().empty())
    throw InputError(name, ": not a plan: expected experiments as in docs/reference/PAPER.md");
  return plan.experiment();
}

Experiments chosen_experiments(const std::string& plan) {
  if (fs::is_regular_file(plan)) return parse_plan(read_content(plan), plan);
  std::vector<std::string> known = {"paper"};
  for (const reports::Experiment& experiment : paper_experiments())
    known.push_back(experiment.name());
  const std::vector<std::string> names = comma_separated(plan);
  for (const std::string& name : names)
    if (std::ranges::count(known, name) == 0)
      throw UsageError("--plan: unknown experiment '", name, "'", nearest_name_hint(name, known),
                       "; --plan list shows them all");
  Experiments chosen;
  for (const reports::Experiment& experiment : paper_experiments())
    if (std::ranges::count(names, experiment.name()) + std::ranges::count(names, "paper"))
      *chosen.Add() = experiment;
  return chosen;
}

void add_notes(const std::vector<models::FoundModel>& networks,
               const std::vector<Feature>& features, reports::Experiment* experiment) {
  for (const char* name : {"bvlc_alexnet", "vgg_cnn_s", "places_cnds8"})
    if (experiment->every_layer() && !std::ranges::count(networks, name, &models::FoundModel::name))
      experiment->add_notes(str("network ", name, ": no weights; see 'revisit models list'"));
  if (features.empty()) experiment->add_notes("No network was found: give --model DIR.");
  if (experiment->every_layer()) return;
  for (const Feature& feature : features) experiment->add_notes("Feature: " + feature.name + ".");
}

Arguments arguments_of(const EvalOptions& options, const reports::Experiment& experiment,
                       const Feature& feature, const reports::ExperimentRun& run) {
  const FeatureOptions& shared = options.feature;
  Arguments arguments = {shared.data,       "--sequence", run.panel(), "--every",
                         str(shared.every), "--sensor",   "hdl64"};
  if (shared.image.given.contains("width"))
    add({"--geometry", str("width=", shared.image.given.at("width"))}, &arguments);
  add(feature.name.empty() ? Arguments{"--feature", run.feature()} : feature.arguments, &arguments);
  std::istringstream words(run.options() + " " + experiment.options());
  add({std::istream_iterator<std::string>(words), {}}, &arguments);
  add({"--cache", options.output / "cache", "--threads", str(shared.threads)}, &arguments);
  if (shared.quiet) arguments.emplace_back("--quiet");
  return arguments;
}

/// Removes large files of a feature before those of the next are written.
class LargeFiles {
 public:
  ~LargeFiles() { remove(); }
  void keep_only(const EvaluationKey& key) {
    if (!files_.contains(key.feature)) remove();
    files_.insert(key.large_files.begin(), key.large_files.end());
  }

 private:
  void remove() {
    std::error_code ignored;
    for (const fs::path& file : files_) fs::remove(file, ignored);
    files_.clear();
  }
  std::set<fs::path> files_;
};

void carry_out(const EvalOptions& options, const Arguments& arguments, LargeFiles& large,
               reports::ExperimentRun* result) {
  result->set_state("skipped");  // if something is missing
  EvalOptions eval = parse_eval_options(arguments);
  const EvaluationKey key = evaluation_key(eval);
  eval.output = options.output / "runs" / short_name_of(key.text);
  large.keep_only(key);
  fs::path folder = finished_run(eval.output, key.text);
  if (folder.empty()) {
    if (!eval.feature.quiet) std::cerr << "run: " << command_of(eval) << "\n";
    result->set_state("failed");
    folder = evaluate(eval).run;
  }
  reports::Run run;
  read_report(folder / "run.json", &run);
  const reports::RunInfo& info = run.info();
  result->set_state("done");
  result->set_folder((".." / fs::relative(folder, options.output)).string());
  result->set_command(info.command());
  result->set_trained(info.trained() || !info.has_trained());
  result->set_feature_dimension(info.feature_dimension());
  result->set_descriptor_dimension(info.descriptor_dimension());
  if (info.has_frames_per_second()) result->set_frames_per_second(info.frames_per_second());
  for (const reports::RunTask& task : run.tasks()) *result->mutable_metrics() = task.metrics();
}

/// Checks options that all runs share, because in a run an error would only skip it.
void check_shared(const EvalOptions& options) {
  const FeatureOptions& feature = options.feature;
  if (!fs::is_directory(feature.data))
    throw InputError(feature.data.string(), ": no folder of drives");
  feature.image.geometry();
}

}  // namespace

const Experiments& paper_experiments() {
  static const Experiments experiments = parse_plan(kPaperPlan, "paper_plan.txtpb");
  return experiments;
}

void print_plans(std::ostream& out) {
  Table table({"experiment", "comparison"});
  for (const reports::Experiment& experiment : paper_experiments())
    table.row({experiment.name(), experiment.question()});
  table.print(out);
}

void plan_experiment(const EvalOptions& options, const std::vector<models::FoundModel>& networks,
                     reports::Experiment* experiment, PlannedRuns* runs) {
  experiment->set_version(REVISIT_VERSION);
  std::vector<Feature> features = features_of(networks, experiment->every_layer());
  add_notes(networks, features, experiment);
  features.emplace_back();  // for curves without a network
  std::set<std::string> of_networks;
  for (const reports::ExperimentRun& curve : experiment->curve())
    if (curve.feature().empty()) of_networks.insert(curve.label());
  for (const std::string& sequence : experiment->sequences()) {
    if (fs::exists(options.feature.data / "sequences" / sequence / "simulation.txt"))
      experiment->set_simulated(true);
    for (const Feature& feature : features)
      for (const reports::ExperimentRun& curve : experiment->curve()) {
        if (curve.feature().empty() == feature.name.empty()) continue;
        reports::ExperimentRun& run = *experiment->add_runs();
        run = curve;
        run.set_panel(sequence);
        run.set_label(feature.prefix + curve.label());
        if (!feature.name.empty()) run.set_feature("cnn");
        for (std::string& label : *run.mutable_better_than())
          if (of_networks.contains(label)) label.insert(0, feature.prefix);
        runs->emplace(arguments_of(options, *experiment, feature, run), &run);
      }
  }
  experiment->clear_curve();
  if (experiment->simulated())
    experiment->add_notes("Simulated drives: figures are not those of KITTI.");
}

void check_claims(reports::Experiment* experiment) {
  std::map<std::pair<std::string, std::string>, const reports::Metrics*> figures;  // panel, label
  for (const reports::ExperimentRun& run : experiment->runs())
    if (run.state() == "done" && run.trained() && run.metrics().has_average_precision())
      figures[{run.panel(), run.label()}] = &run.metrics();
  for (const reports::ExperimentRun& run : experiment->runs())
    for (const std::string& label : run.better_than()) {
      const auto better = figures.find({run.panel(), run.label()});
      const auto worse = figures.find({run.panel(), label});
      if (better == figures.end() || worse == figures.end()) continue;
      const double more = better->second->average_precision();
      const double less = worse->second->average_precision();
      reports::ExperimentClaim& claim = *experiment->add_claims();
      claim.set_text(run.label() + (run.has_slack() ? " is not worse than " : " is better than ") +
                     label);
      if (run.has_slack()) claim.set_text(str(claim.text(), " by more than ", run.slack()));
      claim.set_panel(run.panel());
      claim.set_better(run.label());
      claim.set_worse(label);
      claim.set_better_average_precision(more);
      claim.set_worse_average_precision(less);
      claim.set_holds(more >= less - run.slack());
      // Overlapping intervals support a claim of near equality.
      const bool as_claimed = run.has_slack() && claim.holds();
      const auto is_within = [](double value, const auto& interval) {
        return interval.size() == 2 && interval[0] <= value && value <= interval[1];
      };
      claim.set_undecided(!as_claimed && is_within(more, worse->second->average_precision_ci()) &&
                          is_within(less, better->second->average_precision_ci()));
    }
}

Experiments carry_out_plan(const EvalOptions& options, const std::string& command) {
  Experiments experiments = chosen_experiments(options.plan);
  check_shared(options);
  const std::vector<models::FoundModel> networks = models::all_models(options.feature.model);
  PlannedRuns runs;
  for (reports::Experiment& experiment : experiments) {
    plan_experiment(options, networks, &experiment, &runs);
    experiment.set_command(command);
  }
  LargeFiles large;
  for (const auto& [arguments, result] : runs) try {
      carry_out(options, arguments, large, result);
    } catch (const Interrupted&) {
      throw;
    } catch (const Error& error) {
      result->set_reason(error.what());
    }
  for (reports::Experiment& experiment : experiments) {
    check_claims(&experiment);
    write_json(options.output / experiment.name() / "experiment.json", experiment);
  }
  return experiments;
}

}  // namespace revisit::cli
