#pragma once

#include <vector>

#include "loops/open_recognizer.h"
#include "revisit/evaluation/evaluate.h"
#include "revisit/loops/loop_detector.h"

namespace revisit::cli {

struct DrivingOrderOptions {
  LoopDetectorOptions detector;
  MatchRule rule;                // without a list of pairs
  EvaluationOptions evaluation;  // only score and intervals
  Observer observer;
};

/// Queries each scan against the scans before it, as `revisit loops` does: one task,
/// "driving-order". `scans`: those of the trajectory, with T_world_sensor. Throws what recognize()
/// throws. Throws UsageError if no scan has a candidate, no listed place can be found, the PCA was
/// not estimated, or registered loops get --score.
EvaluationResult evaluate_in_driving_order(const std::vector<ScanRef>& scans,
                                           const Trajectory& trajectory,
                                           const RecognizerSource& source,
                                           const DrivingOrderOptions& options);

}  // namespace revisit::cli
