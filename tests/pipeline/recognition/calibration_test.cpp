#include "revisit/recognition/calibration.h"

#include "testing.h"

namespace revisit {
namespace {

Calibration of_blocks(std::vector<CalibrationBlock> blocks) {
  Calibration calibration;
  calibration.blocks = std::move(blocks);
  return calibration;
}

/// Probability of a correct match grows from 0 to 1 around `middle`.
std::vector<LabeledScore> drawn(int count, double middle, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> score(0, 1), chance(0, 1);
  std::vector<LabeledScore> matches;
  for (int i = 0; i < count; ++i) {
    const double s = std::round(200 * score(random)) / 200;  // some scores are equal
    matches.push_back({s, chance(random) < 1 / (1 + std::exp(-20 * (s - middle)))});
  }
  return matches;
}

TEST(Calibration, NeighborsInTheWrongOrderArePooled) {
  // Pooled with an additional correct match at 1 and an incorrect one at 6.
  const Calibration c =
      isotonic_calibration({{4, false}, {1, false}, {3, true}, {6, true}, {2, false}, {5, true}});
  ASSERT_EQ(c.blocks.size(), 3);
  const std::vector<CalibrationBlock> expected = {{1, 2, 0}, {3, 2, 1}, {5, 2, 2}};
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(c.blocks[i].lowest, expected[i].lowest);
    EXPECT_EQ(c.blocks[i].matches, expected[i].matches);
    EXPECT_EQ(c.blocks[i].correct, expected[i].correct);
  }
  const std::vector<std::pair<double, double>> expected_of = {
      {-9, 1 / 3.0}, {2.9, 1 / 3.0}, {3, 0.5}, {4.99, 0.5}, {5, 2 / 3.0}, {9, 2 / 3.0}};
  for (const auto& [score, probability] : expected_of)
    EXPECT_DOUBLE_EQ(c.probability(score), probability) << score;
}

TEST(Calibration, WhereFewerMatchesAreRightAWrongOneCountsMore) {
  // 3 of 6 are correct; for 1 of 4, incorrect ones count three times. With one more at both ends:
  //   score      1    2    3    4    5    6
  //   correct  1/4  0/3  1/1  0/3  1/1  1/2
  //   pooled   1/7       1/4       2/3
  const Calibration c = isotonic_calibration(
      {{4, false}, {1, false}, {3, true}, {6, true}, {2, false}, {5, true}}, 0.25);
  ASSERT_EQ(c.blocks.size(), 3);
  EXPECT_DOUBLE_EQ(c.probability(1), 1 / 7.0);
  EXPECT_DOUBLE_EQ(c.probability(3), 1 / 4.0);
  EXPECT_DOUBLE_EQ(c.probability(5), 2 / 3.0);
  EXPECT_DOUBLE_EQ(c.blocks[0].matches, 6);
  // 1 of 2 is correct; for 1 of 4, the incorrect one counts three times.
  //   score      1    2
  //   correct  1/4  1/2, with one more at both ends
  const Calibration of_two = isotonic_calibration({{1, false}, {2, true}}, 0.25);
  EXPECT_DOUBLE_EQ(of_two.probability(1), 1 / 4.0);
  EXPECT_DOUBLE_EQ(of_two.probability(2), 1 / 2.0);
  // No incorrect matches, so their rate is unknown.
  EXPECT_DOUBLE_EQ(isotonic_calibration({{1, true}}, 0.25).probability(1), 2 / 3.0);
}

TEST(Calibration, MatchesOfOneScoreAreOneGroup) {
  // 2: 1 of 2 correct, and one correct more; 3: 2 of 2, and one incorrect more.
  const Calibration c = isotonic_calibration({{2, true}, {3, true}, {2, false}, {3, true}});
  ASSERT_EQ(c.blocks.size(), 1) << "2/3 and 2/3 are one block";
  EXPECT_DOUBLE_EQ(c.probability(2), 4 / 6.0);
}

/// Reference: the isotonic fit is max over a <= i of min over b >= i of the mean of a to b.
TEST(Calibration, IsTheFitThatTheMinMaxFormulaGives) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    std::vector<LabeledScore> matches = drawn(300, 0.5, seed);
    const Calibration c = isotonic_calibration(matches);
    std::ranges::sort(matches, {}, &LabeledScore::score);
    std::vector<double> scores, right, all;
    for (const LabeledScore& match : matches) {
      if (scores.empty() || scores.back() != match.score) {
        scores.push_back(match.score);
        right.push_back(0);
        all.push_back(0);
      }
      right.back() += match.correct ? 1 : 0;
      all.back() += 1;
    }
    right.front() += 1, all.front() += 1, all.back() += 1;
    const auto n = scores.size();
    for (size_t i = 0; i < n; ++i) {
      double most = 0;
      for (size_t a = 0; a <= i; ++a) {
        double least = 1, sum = 0, count = 0;
        for (size_t b = a; b < n; ++b) {
          sum += right[b], count += all[b];
          if (b >= i) least = std::min(least, sum / count);
        }
        most = std::max(most, least);
      }
      EXPECT_NEAR(c.probability(scores[i]), most, 1e-12) << scores[i];
    }
  }
}

TEST(Calibration, ProbabilitiesNeverFallAndAreNeverSure) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    const Calibration c = isotonic_calibration(drawn(2000, 0.3, seed));
    for (const Calibration& one : {c, refined(c, drawn(100, 0.6, seed + 10))}) {
      double last = 0;
      for (double s = -0.5; s < 1.5; s += 0.01) {
        const double p = one.probability(s);
        EXPECT_GT(p, 0);
        EXPECT_LT(p, 1);
        EXPECT_GE(p, last);
        last = p;
      }
    }
  }
  EXPECT_DOUBLE_EQ(isotonic_calibration({{1, true}}).probability(1), 2 / 3.0);
}

TEST(Calibration, FewExamplesDoNotPromiseMuch) {
  // Wilson's lower end for 100 of 100 is 100 / (100 + 1.645^2), about 0.97366.
  const Calibration c = of_blocks({{0, 100, 0}, {1, 100, 100}});
  EXPECT_EQ(c.threshold_for(0.97), 1);
  EXPECT_FALSE(c.threshold_for(0.98));
  EXPECT_NEAR(c.max_precision(), 0.9736573, 1e-7);
  EXPECT_EQ(of_blocks({{0, 1, 0}, {1, 268, 268}}).threshold_for(0.99), 1);
  EXPECT_FALSE(of_blocks({{0, 1, 0}, {1, 267, 267}}).threshold_for(0.99));
}

TEST(Calibration, ThePrecisionIsThatOfAllThatIsAccepted) {
  // 500 of 500 from 0.7 on: 0.99462; 650 of 700 from 0.5 on: 0.91086.
  const Calibration c = of_blocks({{0.3, 1000, 100}, {0.5, 200, 150}, {0.7, 500, 500}});
  EXPECT_EQ(c.threshold_for(0.9946), 0.7);
  EXPECT_FALSE(c.threshold_for(0.9947));
  EXPECT_EQ(c.threshold_for(0.92), 0.7);
  EXPECT_EQ(c.threshold_for(0.91), 0.5);
  EXPECT_EQ(c.threshold_for(0.1), 0.5) << "what is rather wrong than right is not accepted";
  // More matches at lower scores can reach a precision that few at higher scores cannot.
  EXPECT_EQ(of_blocks({{0.3, 1000, 0}, {0.5, 400, 398}, {0.7, 100, 100}}).threshold_for(0.985),
            0.5);
  for (const double precision : {0.0, 1.0, -1.0, std::nan("")})
    expect_error<UsageError>([&] { c.threshold_for(precision); }, {"precision"});
}

TEST(Calibration, MatchesOfAnotherDriveMoveItAsFarAsTheyTell) {
  const Calibration before = isotonic_calibration(drawn(4000, 0.5, 1));
  const auto largest_move = [&](const std::vector<LabeledScore>& matches) {
    const Calibration after = refined(before, matches);
    double most = 0;
    for (double s = 0; s <= 1; s += 0.02)
      most = std::max(most, std::abs(after.probability(s) - before.probability(s)));
    return most;
  };
  EXPECT_LT(largest_move(drawn(4000, 0.5, 2)), 0.05);
  EXPECT_LT(largest_move(drawn(3, 0.5, 3)), 0.15);
  EXPECT_GT(largest_move(drawn(1000, 0.8, 4)), 0.5);
  // Correct matches begin at higher scores.
  const Calibration after = refined(before, drawn(1000, 0.8, 4));
  EXPECT_LT(after.probability(0.65), 0.3);
  EXPECT_GT(before.probability(0.65), 0.8);
  EXPECT_GT(after.threshold_for(0.9).value_or(2), before.threshold_for(0.9).value());
}

TEST(Calibration, MatchesThatAreAsWasSaidTakeNothingFromThePromise) {
  std::vector<LabeledScore> matches(300, {1, true});
  matches.insert(matches.end(), 500, {0, false});
  const Calibration before = isotonic_calibration(matches);
  const Calibration after = refined(before, matches);
  EXPECT_GE(after.max_precision(), before.max_precision());
  EXPECT_LE(after.probability(0), before.probability(0));
}

/// Reference: the same maximum by grid search.
TEST(Calibration, TheMostLikelyShiftAndSlopeAreTaken) {
  const Calibration before = isotonic_calibration(drawn(4000, 0.5, 1));
  const std::vector<LabeledScore> matches = drawn(60, 0.62, 5);
  const auto logit = [&](double s) {
    const double p = before.probability(s);
    return std::log(p / (1 - p));
  };
  double best = -std::numeric_limits<double>::infinity(), shift = 0, slope = 0;
  for (double a = -4; a <= 2; a += 0.01)
    for (double b = 0.2; b <= 2; b += 0.01) {
      double likelihood = -a * a / 2 - (b - 1) * (b - 1) * 2;
      for (const LabeledScore& match : matches) {
        const double x = a + b * logit(match.score);
        likelihood -= std::log1p(std::exp(match.correct ? -x : x));
      }
      if (likelihood > best) best = likelihood, shift = a, slope = b;
    }
  const Calibration after = refined(before, matches);
  // Middle scores, where additional matches do not count.
  for (const double s : {0.45, 0.5, 0.55, 0.6})
    EXPECT_NEAR(after.probability(s), 1 / (1 + std::exp(-(shift + slope * logit(s)))), 0.01) << s;
}

TEST(Calibration, IsWrittenAndRead) {
  Calibration c = isotonic_calibration(drawn(500, 0.5, 7));
  c.k = 7;
  c.score = Score::kSimilarity;
  c.radius = 3, c.negative_radius = 9;
  c.trained_on = "a town";
  const std::string content = calibration_content(c);
  const Calibration read = parse_calibration(content, "x");
  EXPECT_EQ(read, c);
  EXPECT_EQ(read.k, 7);
  EXPECT_EQ(read.score, Score::kSimilarity);
  EXPECT_EQ(read.radius, 3);
  EXPECT_EQ(read.negative_radius, 9);
  EXPECT_EQ(read.trained_on, "a town");
  ASSERT_EQ(read.blocks.size(), c.blocks.size());
  EXPECT_EQ(read.probability(0.5), c.probability(0.5));
}

TEST(Calibration, DamagedOnesAreRefused) {
  const auto refused = [](const Calibration& c, const std::string& why) {
    expect_error<InputError>([&] { parse_calibration(calibration_content(c), "m.map"); },
                             {"m.map", why});
  };
  refused(of_blocks({}), "no blocks");
  refused(of_blocks({{1, 5, 0}, {1, 5, 5}}), "do not ascend");
  refused(of_blocks({{1, 5, 5}, {2, 5, 1}}), "lower probability");
  refused(of_blocks({{1, 5, 6}}), "6 of 5");
  refused(of_blocks({{1, 0, 0}}), "0 of 0");
  refused(of_blocks({{1, std::nan(""), 1}}), "matches");
  refused(of_blocks({{std::nan(""), 5, 1}}), "do not ascend");
  Calibration no_k = of_blocks({{1, 5, 1}});
  no_k.k = 0;
  refused(no_k, "k is 0");
  expect_error<InputError>([] { parse_calibration("\xff\xff", "m.map"); }, {"m.map"});
}

TEST(Calibration, NeedsMatchesWithScores) {
  expect_error<UsageError>([] { isotonic_calibration({}); }, {"found none"});
  expect_error<UsageError>([] { isotonic_calibration({{std::nan(""), true}}); }, {"nan"});
  for (const double share : {0.0, 1.0, std::nan("")})
    expect_error<UsageError>(
        [share] {
          isotonic_calibration({{1, true}, {0, false}}, share);
        },
        {"prior of correct matches", "found"});
  expect_error<UsageError>([] { refined(of_blocks({{0, 2, 1}}), {}); }, {"found none"});
}

TEST(Calibration, NeedsBlocks) {
  const std::vector<LabeledScore> matches = {{1, true}, {0, false}};
  expect_error<UsageError>([] { Calibration().probability(1); }, {"no blocks"});
  expect_error<UsageError>([&] { refined({}, matches); }, {"no blocks"});
  EXPECT_FALSE(Calibration().threshold_for(0.5));
}

}  // namespace
}  // namespace revisit
