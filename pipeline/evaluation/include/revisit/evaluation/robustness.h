#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "revisit/datasets/alteration.h"
#include "revisit/evaluation/descriptors.h"
#include "revisit/evaluation/ground_truth.h"

namespace revisit::pipeline {

struct RobustnessOptions {
  std::vector<Alteration> alterations = standard_alterations();
  uint32_t seed = 0;    // of what is random in them
  int64_t queries = 0;  // so many scans, evenly through the drive, are altered; 0: all
  TrueMatchRule rule;   // which scans show the same place, and which another one
  /// Truth in the place of `rule`: queries that it knows are asked among the scans before them.
  std::optional<ListedPairs> listed;
  /// Scans this near in time are no neighbours, as the scan's own original never is.
  Exclusion exclusion{Exclusion::Kind::kNone, 0};
  bool both_cases = false;  // asks in alignment cases 1 and 2; the higher similarity counts
  int threads = 1;          // of the search; the figures do not depend on it
  DescribeOptions describe;
  ReductionOptions reduction;
  std::filesystem::path cache;  // folder of the features, and of the PCA
};

/// Result of one alteration. Scans that cannot be described find nothing, with similarity 0.
struct RobustnessRow {
  Alteration alteration;
  int64_t asked = 0, own = 0;        // scans, and those that find their own original
  int64_t asked_near = 0, near = 0;  // that have a neighbour, and those that find one of theirs
  /// Similarity of the best neighbour / the best scan of another place; NaN without neighbours.
  double ratio_median = 0, ratio_least = 0;
  /// Of the best match among all but its own moment, scored as PlaceRecognizer scores it.
  double recall_at_1 = 0, average_precision = 0;
  int64_t not_described = 0;
};

struct RobustnessResult {
  std::vector<RobustnessRow> rows;  // as the alterations
  int64_t stored = 0;               // scans that could be found
  std::vector<int64_t> left_out;    // scans of the drive, then of `among`, that are not
  int64_t numbers = 0;              // of a descriptor
};

/// Alters scans of a drive and searches each among the unaltered ones of the drive and of `among`,
/// other places of the same sensor. Features are kept in the cache: interrupted calls resume.
///
/// Throws UsageError for a drive without poses (named places, for Distance::kPlace), a feature of
/// camera images or invalid options, Interrupted, and what describing and reducing throw.
RobustnessResult robustness(const Dataset& drive, const std::vector<Dataset>& among,
                            const FeatureExtractor& extractor, const RobustnessOptions& options,
                            const Observer& observer = {});

}  // namespace revisit::pipeline
