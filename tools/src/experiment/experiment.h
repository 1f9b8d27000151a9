#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "eval/feature_options.h"
#include "models/find_model.h"
#include "reports.pb.h"

namespace revisit::cli {

/// The paper's nine experiments, in its order: experiments.txtpb.
const google::protobuf::RepeatedPtrField<reports::PlannedExperiment>& paper_experiments();

struct ExperimentOptions {
  std::vector<std::string> names;
  std::vector<std::filesystem::path> models;
  FeatureOptions feature;               // of all runs; its data are the drives
  std::filesystem::path hkust, output;  // sets of places; the folder of the experiments
  bool no_report = false;
};

/// Runs of `revisit eval` by arguments: of each feature first --pca 0, whose PCA serves the others.
using Runs = std::multimap<Arguments, reports::ExperimentRun*>;

/// Fills in the report of an experiment but for its results, and adds its runs to `runs`.
void plan_experiment(const reports::PlannedExperiment& experiment, const ExperimentOptions& options,
                     const std::vector<models::FoundModel>& networks, reports::Experiment* report,
                     Runs* runs);

/// Carries out the runs in `options.output`: folders in `runs/`, shared files in `cache/`. Skips
/// unchanged finished runs, and, for a reason, what cannot run. Throws Interrupted; keeps runs.
void carry_out(const ExperimentOptions& options, const Runs& runs);

/// Adds whether each claim holds on each sequence with both of its curves, of trained networks.
void check_claims(reports::Experiment* report);

}  // namespace revisit::cli
