#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "revisit/datasets/dataset.h"
#include "revisit/evaluation/ground_truth.h"
#include "revisit/loops/loop_detector.h"
#include "revisit/maps/map.h"

namespace revisit::cli {

struct LabeledMatch {
  LabeledScore score;
  bool perturbed = false;
  Pose pose;  // of the scan
};

struct LabelingOptions {
  Exclusion exclusion;
  MatchRule rule;
  int augmentations = 0;  // perturbed copies of every scan, as further queries
  uint64_t seed = 0;      // of the perturbations
  std::function<void(int64_t done, int64_t total)> done;
  int64_t* skipped = nullptr;  // counts scans that cannot be described
};

/// Queries each scan, which must have a pose, against the scans before it. Map entries are
/// unperturbed. Omits matches that are neither true nor false, scans that cannot be described, and
/// copies that equal the scan. Throws what recognize() throws.
std::vector<LabeledMatch> labeled_matches(const Dataset& drive, Map& map,
                                          const LabelingOptions& options);

/// Omits matches that are neither true nor false. Throws what recognize() throws.
std::vector<LabeledMatch> labeled_loops(const Dataset& drive, LoopDetector& detector,
                                        const MatchRule& rule, bool deskew,
                                        const std::function<void(int64_t, int64_t)>& done);

/// All correct matches of a place share a weight of 1, and so do all false ones, because scans of
/// one place are not independent. A place begins `radius` [m] from all places before it.
std::vector<LabeledScore> scores_by_place(std::span<const LabeledMatch> matches,
                                          const MatchRule& rule);

/// A match is correct below `radius` [m] and incorrect beyond twice that. In between the vehicle is
/// nearly back, but not at the matched place.
MatchRule rule_of(double radius, const Dataset& drive);

}  // namespace revisit::cli
