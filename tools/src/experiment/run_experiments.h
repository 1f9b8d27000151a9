#pragma once

#include <vector>

#include "experiment/plan.h"
#include "reports.pb.h"

namespace revisit::cli {

/// Carries out the plans below `options.output`: the folders of the runs in `runs/`, what is shared
/// between them in `cache/`, and `<experiment>/experiment.json`. A run that was finished before is
/// not repeated when nothing it depends on has changed. What cannot run is skipped; its reason is
/// in the result. Throws Interrupted; what was done is kept, and the files say what is to do.
std::vector<reports::Experiment> run_experiments(const ExperimentOptions& options,
                                                 const Inventory& inventory,
                                                 std::vector<ExperimentPlan> plans,
                                                 const std::string& command);

/// Adds to `experiment`, whose runs are there, what becomes of each claim of the plan in each panel
/// that has both of its curves, of trained networks.
void check_claims(const ExperimentPlan& plan, reports::Experiment* experiment);

}  // namespace revisit::cli
