#pragma once

#include <vector>

#include "loops/open_recognizer.h"
#include "revisit/evaluation/evaluate.h"
#include "revisit/loops/loop_detector.h"

namespace revisit::cli {

struct CausalOptions {
  pipeline::LoopDetectorOptions detector;
  pipeline::TrueMatchRule rule;            // without a list of pairs
  pipeline::EvaluationOptions evaluation;  // of these the intervals
  pipeline::Observer observer;
  bool strict = false;  // InputError for a scan that cannot be described
};

/// Asks each scan among those before it, as `revisit loops` does, and judges the answers: one task,
/// "causal". Nothing is learnt from later scans. `scans` have T_world_sensor; they are those of the
/// trajectory. Throws what recognise() does, UsageError when no scan has a place to be compared
/// with, when a list has no place that could be found, when the PCA was not learnt, and for a score
/// of loops that are registered.
pipeline::EvaluationResult evaluate_causally(const std::vector<pipeline::ScanRef>& scans,
                                             const pipeline::Trajectory& trajectory,
                                             const RecognizerSource& source,
                                             const CausalOptions& options);

}  // namespace revisit::cli
