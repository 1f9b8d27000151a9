#include "experiment/experiment.h"

#include <google/protobuf/text_format.h>

#include <algorithm>
#include <iostream>
#include <iterator>
#include <set>
#include <sstream>

#include "cli/messages.h"
#include "eval/evaluation.h"
#include "eval/run_folder.h"
#include "eval/run_summary.h"
#include "experiments_table.h"
#include "models/all_models.h"
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
    for (const models::Cut& cut : all ? models::cuts_of(network) : std::vector{network.cut}) {
      Feature& feature = features.emplace_back();
      feature.name = network.name + " " + models::to_string(cut);
      if (!network.trained) feature.name += " (UNTRAINED)";
      feature.arguments = {"--feature",      "cnn",       "--model",
                           network.prototxt, "--weights", network.weights};
      add({"--end", cut.end}, &feature.arguments);
    }
  }
  for (Feature& feature : features)
    feature.prefix = all ? feature.name : features.size() > 1 ? feature.name + ", " : "";
  return features;
}

void remove_files(std::set<fs::path>* files) {
  std::error_code ignored;
  for (const fs::path& file : *files) fs::remove(file, ignored);
  files->clear();
}

}  // namespace

const google::protobuf::RepeatedPtrField<reports::PlannedExperiment>& paper_experiments() {
  static const reports::ExperimentTable table = [] {
    reports::ExperimentTable read;
    if (!google::protobuf::TextFormat::ParseFromString(kExperimentsTable, &read))
      throw Error("experiments.txtpb cannot be read");
    return read;
  }();
  return table.experiment();
}

void plan_experiment(const reports::PlannedExperiment& experiment, const ExperimentOptions& options,
                     const std::vector<models::FoundModel>& networks, reports::Experiment* report,
                     Runs* runs) {
  *report = experiment.report();
  report->set_version(REVISIT_VERSION);
  std::vector<Feature> features = features_of(networks, experiment.every_layer());
  for (const char* name : {"bvlc_alexnet", "vgg_cnn_s", "places_cnds8"})
    if (experiment.every_layer() && !std::ranges::count(networks, name, &models::FoundModel::name))
      report->add_notes(str("network ", name, ": no weights; see 'revisit models list'"));
  if (features.empty()) report->add_notes("No network was found: give --models DIR.");
  for (const Feature& feature : features)
    if (!experiment.every_layer()) report->add_notes("Feature: " + feature.name + ".");
  features.emplace_back();  // for curves without a network
  std::set<std::string> of_networks;
  for (const reports::PlannedCurve& curve : experiment.curve())
    if (curve.feature().empty()) of_networks.insert(curve.label());

  const FeatureOptions& shared = options.feature;
  const auto add_run = [&](const std::string& sequence, const Feature& feature,
                           const reports::PlannedCurve& curve) {
    reports::ExperimentRun& run = *report->add_runs();
    run.set_panel(sequence);
    run.set_label(feature.prefix + curve.label());
    run.set_feature(feature.name.empty() ? curve.feature() : "cnn");
    if (curve.has_method()) *run.mutable_method() = curve.method();
    if (curve.has_slack()) run.set_slack(curve.slack());
    for (const std::string& label : curve.better_than())
      run.add_better_than(of_networks.contains(label) ? feature.prefix + label : label);
    Arguments arguments = {experiment.places() ? options.hkust : shared.data};
    add({"--sequence", sequence, "--every", str(shared.every), "--sensor", "hdl64"}, &arguments);
    if (shared.image.given.contains("width"))
      add({"--geometry", str("width=", shared.image.given.at("width"))}, &arguments);
    add(feature.name.empty() ? Arguments{"--feature", curve.feature()} : feature.arguments,
        &arguments);
    std::istringstream words(curve.options() + " " + experiment.options());
    add({std::istream_iterator<std::string>(words), {}}, &arguments);
    add({"--cache", options.output / "cache", "--threads", str(shared.threads)}, &arguments);
    if (shared.quiet) arguments.emplace_back("--quiet");
    runs->emplace(arguments, &run);
  };
  for (const std::string& sequence : experiment.sequences()) {
    if (fs::exists(shared.data / "sequences" / sequence / "simulation.txt"))
      report->set_simulated(true);
    for (const Feature& feature : features)
      for (const reports::PlannedCurve& curve : experiment.curve())
        if (curve.feature().empty() != feature.name.empty()) add_run(sequence, feature, curve);
  }
  if (report->simulated()) report->add_notes("Simulated drives: figures are not those of KITTI.");
}

void carry_out(const ExperimentOptions& options, const Runs& runs) {
  std::set<fs::path> large;  // files of the current feature, removed before the next
  for (const auto& [arguments, result] : runs) try {
      result->set_state("skipped");  // if something is missing
      if (arguments.front().empty())
        throw UsageError("no data: give --kitti DIR for drives, --hkust DIR for sets of places");
      EvalOptions eval;
      Options of_eval("revisit eval");
      eval.declare(of_eval);
      of_eval.parse(arguments);
      const EvaluationKey key = evaluation_key(eval);
      eval.output = options.output / "runs" / short_name_of(key.text);
      if (!large.contains(key.feature)) remove_files(&large);
      large.insert(key.large_files.begin(), key.large_files.end());
      fs::path folder = finished_run(eval.output, key.text);
      if (folder.empty()) {
        if (!eval.feature.quiet) std::cerr << "run: " << command_of(eval) << "\n";
        result->set_state("failed");
        folder = evaluate(eval).run;
      }
      const FinishedRun run = read_run(folder);
      const reports::RunInfo& info = run.info;
      result->set_state("done");
      result->set_folder((".." / fs::relative(folder, options.output)).string());
      result->set_command(info.command());
      result->set_trained(info.trained() || !info.has_trained());
      result->set_feature_dimension(info.feature_dimension());
      result->set_descriptor_dimension(info.descriptor_dimension());
      if (info.has_frames_per_second()) result->set_frames_per_second(info.frames_per_second());
      for (const reports::Metrics& task : run.metrics.tasks()) *result->mutable_metrics() = task;
    } catch (const Interrupted&) {
      throw;
    } catch (const Error& error) {
      result->set_reason(error.what());
    }
  remove_files(&large);
}

void check_claims(reports::Experiment* report) {
  std::map<std::pair<std::string, std::string>, const reports::Metrics*> figures;  // panel, label
  for (const reports::ExperimentRun& run : report->runs())
    if (run.state() == "done" && run.trained() && run.metrics().has_average_precision())
      figures[{run.panel(), run.label()}] = &run.metrics();
  for (const reports::ExperimentRun& run : report->runs())
    for (const std::string& label : run.better_than()) {
      const auto better = figures.find({run.panel(), run.label()});
      const auto worse = figures.find({run.panel(), label});
      if (better == figures.end() || worse == figures.end()) continue;
      const double more = better->second->average_precision();
      const double less = worse->second->average_precision();
      reports::ExperimentClaim& claim = *report->add_claims();
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

}  // namespace revisit::cli
