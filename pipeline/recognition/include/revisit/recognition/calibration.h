#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "revisit/recognition/match.h"

namespace revisit {

/// A match for calibration.
struct LabeledScore {
  double score = 0;      ///< Match::score
  bool correct = false;  ///< label by the ground truth
  double weight = 1;     ///< below 1 for one of several matches of a place (not independent)
};

/// Matches with scores from `lowest` up to the `lowest` of the next block.
struct CalibrationBlock {
  double lowest = 0;                ///< the first block also covers all lower scores
  double matches = 0, correct = 0;  ///< weighted counts
};

/// Probability that a match is correct, by isotonic regression over labeled matches (Zadrozny and
/// Elkan, KDD 2002). It applies to matches scored in the same way, in similar maps.
struct Calibration {
  int k = 4;                     ///< SearchOptions::k of the scores
  Score score = Score::kMargin;  ///< kind of the scores
  /// [m] Labels: correct within `radius`, incorrect beyond `negative_radius`; others are ignored.
  double radius = 5, negative_radius = 10;
  std::string trained_on;                ///< human-readable
  std::vector<CalibrationBlock> blocks;  ///< by ascending score, with non-decreasing probability

  bool operator==(const Calibration&) const;  ///< all members are equal
  /// Fraction of correct matches in the score's block, in (0, 1). The lowest block counts one
  /// additional correct match and the highest one additional incorrect match, so that 0 and 1 are
  /// never reached. Throws UsageError without blocks.
  double probability(double score) const;
  /// Returns the lowest score from which matches have at least this precision. The test uses the
  /// lower bound of a one-sided 95 % interval (Wilson, JASA 1927): 100 matches without an error
  /// reach 0.97, not 1. Blocks with more incorrect than correct matches are never accepted. Returns
  /// nothing if no score reaches the precision. Throws UsageError unless 0 < precision < 1.
  std::optional<double> threshold_for(double precision) const;
  double max_precision() const;  ///< above it threshold_for() returns nothing
};

/// Fits the non-decreasing probability of correct matches by pool-adjacent-violators, into `blocks`
/// only. `match_prior` is the expected fraction of correct matches in use; incorrect matches are
/// reweighted to it (Elkan, IJCAI 2001, theorem 2), unless all are correct or all incorrect. Throws
/// UsageError without matches, for a score that is not finite, and unless match_prior is in 1e-6 to
/// 1 - 1e-6.
Calibration isotonic_calibration(std::vector<LabeledScore> matches,
                                 std::optional<double> match_prior = std::nullopt);

/// Gives each score the lowest probability of all fits without one sequence, so that no single one
/// decides. Throws UsageError without sequences, and what isotonic_calibration() throws.
Calibration calibrate_leave_one_out(std::span<const std::vector<LabeledScore>> drives,
                                    std::optional<double> match_prior = std::nullopt);

/// Refines a calibration with `matches` of another place or robot: logit p' = a + b logit p. (a, b)
/// is the MAP estimate for a normal prior with mean (0, 1) and standard deviations (1, 0.5). Throws
/// what isotonic_calibration() and probability() throw.
Calibration refined(const Calibration& before, std::span<const LabeledScore> matches);

/// parse_calibration() throws InputError with `name` and the defect.
std::string calibration_content(const Calibration& calibration);
/// Inverse of calibration_content().
Calibration parse_calibration(std::string_view content, const std::string& name);

}  // namespace revisit
