#pragma once

namespace revisit::pipeline {

/// A registration that fits is evidence for a loop. Its odds become kFitOdds times as high: of two
/// real drives, NCLT and MulRan Riverside, 273 of 323 right pairs fit, and 12 of 85 pairs that look
/// alike and lie 500 m apart; their ratio is 6.0.
constexpr double kFitOdds = 6;

/// The probability of a loop that fits, from that which its score gives, less than 1.
constexpr double probability_after_fit(double before) {
  const double odds = kFitOdds * before / (1 - before);
  return odds / (1 + odds);
}

/// What scores must promise, that loops which fit are right with this precision, less than 1.
constexpr double precision_before_fit(double precision) {
  const double odds = precision / (1 - precision) / kFitOdds;
  return odds / (1 + odds);
}

}  // namespace revisit::pipeline
