#pragma once

#include <vector>

#include "loops/open_recognizer.h"
#include "revisit/evaluation/evaluate.h"
#include "revisit/loops/loop_detector.h"

namespace revisit::cli {

struct CausalOptions {
  pipeline::LoopDetectorOptions detector;
  pipeline::TrueMatchRule rule;            // without a list of pairs
  pipeline::EvaluationOptions evaluation;  // only score and intervals
  pipeline::Observer observer;
  bool strict = false;  // InputError for a scan that cannot be described
};

/// Queries each scan against the scans before it, as `revisit loops` does: one task, "causal".
/// `scans`: those of the trajectory, with T_world_sensor. Throws what recognize() throws. Throws
/// UsageError if no scan has a candidate, no listed place can be found, the PCA was not estimated,
/// or registered loops get --score.
pipeline::EvaluationResult evaluate_causally(const std::vector<pipeline::ScanRef>& scans,
                                             const pipeline::Trajectory& trajectory,
                                             const RecognizerSource& source,
                                             const CausalOptions& options);

}  // namespace revisit::cli
