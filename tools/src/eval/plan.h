#pragma once

#include <iosfwd>
#include <map>
#include <string>
#include <vector>

#include "eval/eval_options.h"
#include "models/models.h"
#include "reports.pb.h"

namespace revisit::cli {

using Experiments = google::protobuf::RepeatedPtrField<reports::Experiment>;

/// The paper's nine experiments in its order (paper_plan.txtpb).
const Experiments& paper_experiments();

void print_plans(std::ostream& out);

/// Runs of `revisit eval` by arguments. The order puts --pca 0 first, whose PCA the others reuse.
using PlannedRuns = std::multimap<Arguments, reports::ExperimentRun*>;

/// Adds the runs of an experiment to it and to `runs`, without results.
void plan_experiment(const EvalOptions& options, const std::vector<models::FoundModel>& networks,
                     reports::Experiment* experiment, PlannedRuns* runs);

/// Adds whether each claim holds, for every sequence with both curves from trained networks.
void check_claims(reports::Experiment* experiment);

/// `--plan`: writes folders of runs to `runs/` of `options.output`, shared files to `cache/`, and
/// an experiment.json for each experiment. Skips finished runs with the same options, and
/// impossible runs with a reason. Returns the experiments. Throws UsageError for an unknown name,
/// and Interrupted.
Experiments carry_out_plan(const EvalOptions& options, const std::string& command);

}  // namespace revisit::cli
