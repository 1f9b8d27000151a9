#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "revisit/datasets/perturbation.h"
#include "revisit/evaluation/descriptors.h"
#include "revisit/evaluation/ground_truth.h"

namespace revisit {

struct RobustnessOptions {
  std::vector<Perturbation> perturbations = standard_perturbations();
  uint32_t seed = 0;
  int64_t queries = 0;  // number of perturbed scans, evenly spaced in the drive; 0: all
  TrueMatchRule rule;
  /// Ground truth instead of `rule`; listed queries are compared with the scans before them.
  std::optional<ListedPairs> listed;
  /// Temporal neighbors are not counted as neighbors; neither is the original of the scan.
  Exclusion exclusion{Exclusion::Kind::kNone, 0};
  bool both_cases = false;  // queries in alignment cases 1 and 2; the higher similarity counts
  int threads = 1;          // does not affect the metrics
  DescribeOptions describe;
  ReductionOptions reduction;
  std::filesystem::path cache;
};

/// Result of one perturbation. Scans that cannot be described match nothing, with similarity 0.
struct RobustnessRow {
  Perturbation perturbation;
  int64_t n_queries = 0, own = 0;  // queries, and those that retrieve their own original
  int64_t queries_with_neighbor = 0,
          near = 0;  // queries with neighbors, and those that retrieve one
  /// Similarity of the best neighbor / of the best scan of another place; NaN without neighbors.
  double ratio_median = 0, ratio_min = 0;
  /// For the best match outside the temporal neighbors, scored like PlaceRecognizer::score().
  double recall_at_1 = 0, average_precision = 0;
  int64_t not_described = 0;
};

struct RobustnessResult {
  std::vector<RobustnessRow> rows;
  int64_t stored = 0;
  // Scans of the drive, then of `among`, that are not in the database
  std::vector<int64_t> skipped;
  int64_t numbers = 0;  // dimensions of a descriptor
};

/// Perturbs scans of a drive and uses each as a query against the unperturbed scans of the drive
/// and of the distractors `among`, other places with the same sensor. Features are cached, so that
/// an interrupted call can be resumed.
///
/// Throws UsageError for a drive without poses (for Distance::kPlace: place names), a feature of
/// camera images or invalid options; Interrupted; and what describing and reducing throw.
RobustnessResult robustness(const Dataset& drive, const std::vector<Dataset>& among,
                            const FeatureExtractor& extractor, const RobustnessOptions& options,
                            const Observer& observer = {});

}  // namespace revisit
