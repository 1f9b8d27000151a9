#include "revisit/recognition/calibration.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "calibration/content.h"
#include "revisit/base/error.h"

namespace revisit {
namespace {

double fraction_correct(const CalibrationBlock& block) {
  return block.correct / block.matches;
}

std::vector<CalibrationBlock> with_extremes(std::vector<CalibrationBlock> blocks) {
  if (blocks.empty()) throw UsageError("the calibration has no blocks");
  blocks.front().correct += 1;
  blocks.front().matches += 1;
  blocks.back().matches += 1;
  return blocks;
}

/// Pool-adjacent-violators. `blocks` include the extremes, the result does not.
std::vector<CalibrationBlock> pooled(const std::vector<CalibrationBlock>& blocks) {
  std::vector<CalibrationBlock> pools;
  for (CalibrationBlock pool : blocks) {
    while (!pools.empty() && fraction_correct(pools.back()) >= fraction_correct(pool)) {
      pool.lowest = pools.back().lowest;
      pool.matches += pools.back().matches;
      pool.correct += pools.back().correct;
      pools.pop_back();
    }
    pools.push_back(pool);
  }
  pools.front().correct -= 1;
  pools.front().matches -= 1;
  pools.back().matches -= 1;
  return pools;
}

double wilson_lower_end(double correct, double matches) {
  constexpr double z = 1.6448536269514722;  // 95 % quantile of the normal distribution
  const double p = correct / matches, zz = z * z / matches;
  return (p + zz / 2 - z * std::sqrt(p * (1 - p) / matches + zz / (4 * matches))) / (1 + zz);
}

/// Scores and lower bounds of the precision from there on, by descending score, down to the blocks
/// with more incorrect than correct matches.
std::vector<std::pair<double, double>> precision_bounds(
    const std::vector<CalibrationBlock>& blocks) {
  std::vector<std::pair<double, double>> result;
  double matches = 0, correct = 0;
  for (size_t i = blocks.size(); i-- > 0 && 2 * blocks[i].correct > blocks[i].matches;) {
    matches += blocks[i].matches;
    correct += blocks[i].correct;
    result.emplace_back(blocks[i].lowest, wilson_lower_end(correct, matches));
  }
  return result;
}

double logit(double p) {
  return std::log(p / (1 - p));
}
double sigmoid(double x) {
  return 1 / (1 + std::exp(-x));
}

void check(std::span<const LabeledScore> matches) {
  if (matches.empty()) throw UsageError("calibration: expected labeled matches, found none");
  for (const LabeledScore& match : matches)
    if (!std::isfinite(match.score))
      throw UsageError("calibration: expected finite scores, found ", match.score);
}

/// Weight of an incorrect match for which the fraction of correct ones is `match_prior`.
double weight_of_incorrect(std::span<const LabeledScore> matches,
                           std::optional<double> match_prior) {
  if (!match_prior) return 1;
  constexpr double kLeast = 1e-6;
  if (!(*match_prior >= kLeast && *match_prior <= 1 - kLeast))
    throw UsageError(
        str("prior of correct matches: expected 0.000001 to 0.999999, found ", *match_prior));
  double correct = 0, incorrect = 0;
  for (const LabeledScore& match : matches) (match.correct ? correct : incorrect) += match.weight;
  return correct > 0 && incorrect > 0 ? correct / incorrect * (1 - *match_prior) / *match_prior : 1;
}

std::vector<CalibrationBlock> blocks_of_scores(std::vector<LabeledScore> matches,
                                               std::optional<double> match_prior) {
  check(matches);
  const double incorrect_weight = weight_of_incorrect(matches, match_prior);
  std::ranges::sort(matches, {}, &LabeledScore::score);
  std::vector<CalibrationBlock> blocks;
  for (const LabeledScore& match : matches) {
    if (blocks.empty() || blocks.back().lowest < match.score) blocks.push_back({match.score});
    blocks.back().matches += match.weight * (match.correct ? 1 : incorrect_weight);
    blocks.back().correct += match.correct ? match.weight : 0;
  }
  return blocks;
}

/// Newton's method for a and b of refined(); the function is concave.
std::array<double, 2> shift_and_slope(const Calibration& before,
                                      std::span<const LabeledScore> matches) {
  constexpr double kShiftWeight = 1, kSlopeWeight = 4;  // 1 / variance
  constexpr int kSteps = 50;
  std::vector<double> logits;
  for (const LabeledScore& match : matches)
    logits.push_back(logit(before.probability(match.score)));
  double a = 0, b = 1;
  for (int step = 0; step < kSteps; ++step) {
    double ga = -kShiftWeight * a, gb = -kSlopeWeight * (b - 1);
    double haa = kShiftWeight, hab = 0, hbb = kSlopeWeight;
    for (size_t i = 0; i < matches.size(); ++i) {
      const double x = logits[i], p = sigmoid(a + b * x);
      const double error = matches[i].weight * ((matches[i].correct ? 1 : 0) - p),
                   weight = matches[i].weight * p * (1 - p);
      ga += error, gb += error * x;
      haa += weight, hab += weight * x, hbb += weight * x * x;
    }
    const double determinant = haa * hbb - hab * hab;
    const double da = (hbb * ga - hab * gb) / determinant;
    const double db = (haa * gb - hab * ga) / determinant;
    // Limit the step, because far from the maximum a full step may overshoot.
    const double part = std::min(1.0, 1 / std::max(std::abs(da), std::abs(db)));
    a += part * da, b += part * db;
    if (std::abs(da) + std::abs(db) < 1e-12) break;
  }
  return {a, std::max(0.0, b)};
}

}  // namespace

bool Calibration::operator==(const Calibration& other) const {
  return calibration_content(*this) == calibration_content(other);
}

double Calibration::probability(double of) const {
  const auto after = std::ranges::upper_bound(blocks, of, {}, &CalibrationBlock::lowest);
  const auto i = after == blocks.begin() ? 0 : static_cast<size_t>(after - blocks.begin()) - 1;
  return fraction_correct(with_extremes(blocks)[i]);
}

std::optional<double> Calibration::threshold_for(double precision) const {
  if (!(precision > 0 && precision < 1))
    throw UsageError("precision: expected more than 0 and less than 1, found ", precision);
  std::optional<double> threshold;
  for (const auto& [from, bound] : precision_bounds(blocks))
    if (bound >= precision) threshold = from;
  return threshold;
}

double Calibration::max_precision() const {
  double highest = 0;
  for (const auto& [from, bound] : precision_bounds(blocks)) highest = std::max(highest, bound);
  return highest;
}

Calibration isotonic_calibration(std::vector<LabeledScore> matches,
                                 std::optional<double> match_prior) {
  Calibration result;
  result.blocks = pooled(with_extremes(blocks_of_scores(std::move(matches), match_prior)));
  return result;
}

Calibration calibrate_leave_one_out(std::span<const std::vector<LabeledScore>> drives,
                                    std::optional<double> match_prior) {
  const auto all_but = [&](size_t held_out) {
    std::vector<LabeledScore> matches;
    for (size_t i = 0; i < drives.size(); ++i)
      if (i != held_out) matches.insert(matches.end(), drives[i].begin(), drives[i].end());
    return matches;
  };
  std::vector<Calibration> without;
  for (size_t i = 0; i < drives.size() && drives.size() > 1; ++i)
    without.push_back(isotonic_calibration(all_but(i), match_prior));
  if (without.empty()) return isotonic_calibration(all_but(drives.size()), match_prior);
  std::vector<CalibrationBlock> blocks;
  double before = -1;
  for (const CalibrationBlock& block :
       with_extremes(blocks_of_scores(all_but(drives.size()), match_prior))) {
    double least = 1;
    for (const Calibration& one : without) least = std::min(least, one.probability(block.lowest));
    if (least > before) blocks.push_back({block.lowest});
    blocks.back().matches += block.matches;
    before = least;
    blocks.back().correct = least * blocks.back().matches;
  }
  // Keep what with_extremes() added.
  blocks.front().correct = std::max(blocks.front().correct, 1.0);
  blocks.back().correct = std::min(blocks.back().correct, blocks.back().matches - 1);
  Calibration result;
  result.blocks = pooled(blocks);
  return result;
}

Calibration refined(const Calibration& before, std::span<const LabeledScore> matches) {
  check(matches);
  const auto [a, b] = shift_and_slope(before, matches);
  std::vector<CalibrationBlock> blocks = with_extremes(before.blocks);
  for (CalibrationBlock& block : blocks)
    block.correct = block.matches * sigmoid(a + b * logit(fraction_correct(block)));
  blocks.front().correct = std::max(blocks.front().correct, 1.0);
  blocks.back().correct = std::min(blocks.back().correct, blocks.back().matches - 1);
  Calibration result = before;
  result.blocks = pooled(blocks);
  return result;
}

void fill(const Calibration& from, ring::Calibration& to) {
  to.set_k(from.k);
  to.set_score(name_of(from.score));
  to.set_radius(from.radius);
  to.set_negative_radius(from.negative_radius);
  to.set_trained_on(from.trained_on);
  for (const CalibrationBlock& block : from.blocks) {
    ring::CalibrationBlock& written = *to.add_blocks();
    written.set_lowest(block.lowest);
    written.set_matches(block.matches);
    written.set_correct(block.correct);
  }
}

Calibration calibration_from(const ring::Calibration& from, const std::string& name) {
  const auto expect = [&](bool ok, const std::string& what) {
    if (!ok) throw InputError(name + ": not a usable calibration: " + what);
  };
  Calibration to;
  to.k = from.k();
  expect(to.k >= 1, str("k is ", to.k));
  try {
    to.score = parse_score(from.score());
  } catch (const UsageError& error) {
    expect(false, error.what());
  }
  to.radius = from.radius();
  to.negative_radius = from.negative_radius();
  to.trained_on = from.trained_on();
  expect(from.blocks_size() > 0, "it has no blocks");
  for (const ring::CalibrationBlock& block : from.blocks()) {
    expect(std::isfinite(block.lowest()) &&
               (to.blocks.empty() || to.blocks.back().lowest < block.lowest()),
           "its scores do not ascend");
    // These conditions are false for NaN.
    expect(block.matches() > 0 && std::isfinite(block.matches()) && block.correct() >= 0 &&
               block.correct() <= block.matches(),
           str(block.correct(), " of ", block.matches(), " matches are correct"));
    to.blocks.push_back({block.lowest(), block.matches(), block.correct()});
  }
  for (size_t i = 1; i < to.blocks.size(); ++i)
    expect(to.probability(to.blocks[i - 1].lowest) <= to.probability(to.blocks[i].lowest),
           "a higher score has a lower probability");
  return to;
}

std::string calibration_content(const Calibration& calibration) {
  ring::Calibration message;
  fill(calibration, message);
  return message.SerializeAsString();
}

Calibration parse_calibration(std::string_view content, const std::string& name) {
  ring::Calibration message;
  if (!message.ParseFromArray(content.data(), static_cast<int>(content.size())))
    throw InputError(name + ": not a usable calibration: it is another kind of data, or truncated");
  return calibration_from(message, name);
}

}  // namespace revisit
