#pragma once

#include <string>
#include <vector>

#include "experiment/catalog.h"
#include "experiment/inventory.h"

namespace revisit::cli {

/// One curve of an experiment: an evaluation with these arguments of `revisit eval`, or the reason
/// why there is none.
struct PlannedRun {
  std::string panel;  // curves of one panel share axes: the sequence
  CurveInfo curve;    // its label tells networks apart, too
  Arguments arguments;
  std::string skipped;  // why it cannot run; "" when it can
};

struct ExperimentPlan {
  const ExperimentInfo* info = nullptr;
  std::vector<PlannedRun> runs;
  std::vector<Claim> claims;
  std::vector<std::string> notes;  // what a reader must know
};

/// The runs of the experiments that `options` names, with what there is.
std::vector<ExperimentPlan> make_plans(const ExperimentOptions& options,
                                       const Inventory& inventory);

}  // namespace revisit::cli
