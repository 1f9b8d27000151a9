#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "eval/feature_options.h"
#include "models/find_model.h"
#include "reports.pb.h"

namespace revisit::cli {

/// The paper's nine experiments, in its order: experiments.txtpb.
const reports::ExperimentTable& experiment_table();

struct ExperimentOptions {
  std::vector<std::string> names;
  FeatureOptions shared;  // by all runs; its data are the drives
  std::vector<std::filesystem::path> models;
  std::optional<std::filesystem::path> hkust;
  std::filesystem::path output;
  double feature_mb = 8;
  bool untrained = false, keep_features = false, no_report = false;
};

/// The networks to take features from, and what to know of the others.
struct Networks {
  std::vector<models::FoundModel> found;
  std::vector<std::string> missing, passed_over;
};

/// Throws UsageError for folders that do not exist.
Networks find_networks(const ExperimentOptions& options);

/// An experiment: its report, whose runs are to do, or skipped for a reason.
struct Plan {
  reports::Experiment report;
  std::vector<Arguments> arguments;  // of `revisit eval`, for each run
  std::vector<reports::PlannedClaim> claims;
};

/// Plans the experiments that `options` names.
std::vector<Plan> make_plans(const ExperimentOptions& options, const Networks& networks);

/// Carries out the plans below `options.output`: the folders of the runs in `runs/`, what is shared
/// between them in `cache/`, and `<experiment>/experiment.json`. A run that was finished before is
/// not repeated when nothing it depends on has changed. What cannot run is skipped; its reason is
/// in the report. Throws Interrupted; what was done is kept, and the files say what is to do.
std::vector<reports::Experiment> run_plans(const ExperimentOptions& options,
                                           const std::vector<Plan>& plans,
                                           const std::string& command);

/// Adds to a report with finished runs whether each claim holds on each sequence that has both of
/// its curves, of trained networks.
void check_claims(const std::vector<reports::PlannedClaim>& claims, reports::Experiment* report);

}  // namespace revisit::cli
