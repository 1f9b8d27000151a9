#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "revisit/recognition/match.h"

namespace revisit::pipeline {

/// The score of a match whose truth is known.
struct JudgedScore {
  double score = 0;
  bool right = false;
  double weight = 1;  // less for one of several of a place, which are not independent
};

/// Matches whose scores lie from `lowest` up to the next block's.
struct CalibrationBlock {
  double lowest = 0;              // the first block holds all that is lower, too
  double matches = 0, right = 0;  // how many were judged, and how many of these were right
};

/// How likely a match with some score is right, and from which score on matches are to be accepted.
/// It is learnt from judged matches by isotonic regression (Zadrozny and Elkan, KDD 2002), and
/// holds for matches that were scored in the same way, in maps and on drives like those judged.
struct Calibration {
  int k = 4;
  Score score = Score::kMargin;
  /// A place nearer than `radius` was right, one farther than `wrong_beyond` wrong; others were not
  /// counted [m].
  double radius = 5, wrong_beyond = 10;
  std::string learnt_from;               // for people
  std::vector<CalibrationBlock> blocks;  // by ascending score; their probability never falls

  bool operator==(const Calibration&) const;
  /// In (0, 1), never less for a higher score: the share of right ones in the score's block. One
  /// more right match is counted in the lowest block and one more wrong one in the highest, so that
  /// no number of examples makes sure of anything. Throws UsageError without blocks.
  double probability(double score) const;
  /// The lowest score from which on matches are right with this precision, or more of them: by the
  /// lower end of a one-sided 95 % interval (Wilson, JASA 1927), so that 100 matches without a
  /// mistake promise 0.97 and not 1. Blocks that are wrong more often than right are never
  /// accepted. Nothing when no score promises so much. Throws UsageError unless 0 < precision < 1.
  std::optional<double> threshold_for(double precision) const;
  /// The highest precision that a score promises.
  double highest_precision() const;
};

/// Pool-adjacent-violators: the non-decreasing shares of right matches that fit best. Where the
/// calibration is for drives that come back less often, or more often, than those judged,
/// `right_share` is the share of right matches there: each wrong one counts so much that the judged
/// have it (Elkan, IJCAI 2001, theorem 2). Fills all but `k`, `score`, the distances and
/// `learnt_from`. Throws UsageError without matches, for a score that is not finite and unless
/// right_share is 1e-6 to 1 - 1e-6; matches that are all right, or all wrong, keep their weight.
Calibration isotonic_calibration(std::vector<JudgedScore> matches,
                                 std::optional<double> right_share = std::nullopt);

/// The same for matches of several drives: of every score the least probability that they give when
/// one of them is left out, so that no promise rests on one drive. Throws UsageError without
/// drives, and as isotonic_calibration() of what is left does.
Calibration calibration_of_drives(std::span<const std::vector<JudgedScore>> drives,
                                  std::optional<double> right_share = std::nullopt);

/// What `matches` of another place or robot add to `before`: logit p' = a + b logit p, with the
/// most likely a and b when a is about 0 and b about 1, by a normal distribution of deviation 1 and
/// 0.5. Throws as isotonic_calibration() and probability() do.
Calibration refined(const Calibration& before, std::span<const JudgedScore> matches);

/// The mean of (p - right)^2 over matches (Brier, 1950): 0 is best.
double brier_score(const Calibration& calibration, std::span<const JudgedScore> matches);

/// How well probabilities hold: matches of similar probability, and how many of them were right.
struct ReliabilityBin {
  double predicted = 0;  // mean probability
  double observed = 0;   // share of right ones
  int64_t matches = 0;
};
/// Bins of [0, 1] of equal width, without the empty ones.
std::vector<ReliabilityBin> reliability(const Calibration& calibration,
                                        std::span<const JudgedScore> matches, int bins = 10);

/// As a map keeps it. parse_calibration() throws InputError naming `name` and what is wrong.
std::string calibration_content(const Calibration& calibration);
Calibration parse_calibration(std::string_view content, const std::string& name);

}  // namespace revisit::pipeline
