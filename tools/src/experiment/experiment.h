#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "eval/feature_options.h"
#include "models/find_model.h"
#include "reports.pb.h"

namespace revisit::cli {

/// The paper's nine experiments in its order (experiments.txtpb).
const google::protobuf::RepeatedPtrField<reports::PlannedExperiment>& paper_experiments();

struct ExperimentOptions {
  std::vector<std::string> names;
  std::vector<std::filesystem::path> models;
  FeatureOptions feature;               // of all runs; `data`: the drives
  std::filesystem::path hkust, output;  // sets of places; the folder of the experiments
  bool no_report = false;

  void declare(Options& options);
};

/// Runs of `revisit eval` by arguments. The order puts --pca 0 first, whose PCA the others reuse.
using Runs = std::multimap<Arguments, reports::ExperimentRun*>;

/// Fills in the report of an experiment without results, and adds its runs to `runs`.
void plan_experiment(const reports::PlannedExperiment& experiment, const ExperimentOptions& options,
                     const std::vector<models::FoundModel>& networks, reports::Experiment* report,
                     Runs* runs);

/// Writes folders of runs to `runs/` of `options.output` and shared files to `cache/`. Skips
/// finished runs with the same options, and impossible runs with a reason. Throws Interrupted.
void carry_out(const ExperimentOptions& options, const Runs& runs);

/// Adds whether each claim holds, for every sequence with both curves from trained networks.
void check_claims(reports::Experiment* report);

}  // namespace revisit::cli
