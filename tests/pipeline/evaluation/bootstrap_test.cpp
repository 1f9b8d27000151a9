#include "ballots.h"
#include "revisit/evaluation/precision_recall.h"
#include "testing.h"

namespace revisit {
namespace {

constexpr std::array<double, 2> PrIntervals::*kAll[] = {
    &PrIntervals::f1_max, &PrIntervals::average_precision, &PrIntervals::recall_at_1,
    &PrIntervals::max_recall_at_precision_1, &PrIntervals::extended_precision};

std::vector<MatchLabel> random_verdicts(size_t n, unsigned seed, unsigned n_scores = 1u << 20) {
  std::mt19937 random(seed);
  std::vector<MatchLabel> labels(n);
  for (MatchLabel& v : labels) {
    v.positive = random() % 2;
    v.correct = v.positive && random() % 3;
    v.ignored = !v.correct && random() % 4 == 0;
    v.score = static_cast<double>(random() % n_scores) / n_scores + (v.correct ? 0.3 : 0);
  }
  labels.front().positive = true;
  labels.front().ignored = false;
  return labels;
}

void expect_same(const PrIntervals& a, const PrIntervals& b) {
  for (const auto member : kAll) {
    EXPECT_EQ((a.*member)[0], (b.*member)[0]);
    EXPECT_EQ((a.*member)[1], (b.*member)[1]);
  }
}

/// Each query is a block.
std::vector<int64_t> singles(const std::vector<MatchLabel>& labels) {
  std::vector<int64_t> blocks(labels.size());
  std::iota(blocks.begin(), blocks.end(), int64_t{0});
  return blocks;
}

TEST(Bootstrap, WeightsAreRepetitions) {
  // Reference: summarize() of the repeated list.
  for (unsigned seed = 0; seed < 100; ++seed) {
    SCOPED_TRACE(seed);
    const std::vector<MatchLabel> labels = random_verdicts(1 + seed, seed, 16);
    std::mt19937 random(seed + 1000);
    Weights<3> weights(labels.size());
    std::vector<MatchLabel> repeated[3];
    for (size_t q = 0; q < labels.size(); ++q)
      for (size_t lane = 0; lane < 3; ++lane) {
        weights[q][lane] = random() % 4;
        repeated[lane].insert(repeated[lane].end(), weights[q][lane], labels[q]);
      }
    for (const bool missed : {false, true}) {
      const auto measured = measure<3>(ballots_of(labels, missed), weights);
      for (size_t lane = 0; lane < 3; ++lane) {
        const PrSummary expected = summarize(repeated[lane], missed);
        const auto same = [](double a, double b) {
          return std::isnan(b) ? std::isnan(a) : std::abs(a - b) < 1e-12;
        };
        EXPECT_TRUE(same(measured[lane].f1_max, expected.f1_max));
        EXPECT_TRUE(same(measured[lane].average_precision, expected.average_precision));
        EXPECT_TRUE(same(measured[lane].recall_at_1, expected.recall_at_1));
        EXPECT_TRUE(
            same(measured[lane].max_recall_at_precision_1, expected.max_recall_at_precision_1));
        EXPECT_TRUE(same(measured[lane].extended_precision, expected.extended_precision));
      }
    }
  }
}

TEST(Bootstrap, IntervalOfAShareIsTheBinomialOne) {
  // 400 queries, all with a correct match, 100 of them found. The fraction found in a resample is
  // binomial: mean 0.25, standard deviation sqrt(0.25 * 0.75 / 400) = 0.02165; 95 %: 0.25 -+ 1.96 *
  // 0.02165.
  std::vector<MatchLabel> labels(400, {0.5, false, true});
  for (size_t i = 0; i < 100; ++i) labels[4 * i] = {1, true, true};
  const PrIntervals ci = bootstrap(labels, false, {.blocks = singles(labels), .resamples = 20000});
  EXPECT_NEAR(ci.recall_at_1[0], 0.25 - 0.04243, 0.0025);  // one query is 0.0025
  EXPECT_NEAR(ci.recall_at_1[1], 0.25 + 0.04243, 0.0025);
  const PrIntervals two_thirds = bootstrap(
      labels, false, {.blocks = singles(labels), .resamples = 20000, .confidence = 0.6827});
  EXPECT_NEAR(two_thirds.recall_at_1[0], 0.25 - 0.02165, 0.0025);
  EXPECT_NEAR(two_thirds.recall_at_1[1], 0.25 + 0.02165, 0.0025);
}

TEST(Bootstrap, PercentilesAreLinearBetweenResamples) {
  // Two queries: recall@1 of a resample is 0, 1/2 or 1, with chances 1/4, 1/2, 1/4. At 40 %
  // confidence both ends (30 % and 70 %) are 1/2, at 60 % (20 % and 80 %) they are 0 and 1.
  const std::vector<MatchLabel> labels = {{1, true, true}, {0, false, true}};
  const auto at = [&](double confidence) {
    return bootstrap(labels, false,
                     {.blocks = singles(labels), .resamples = 2000, .confidence = confidence})
        .recall_at_1;
  };
  EXPECT_EQ(at(0.4)[0], 0.5);
  EXPECT_EQ(at(0.4)[1], 0.5);
  EXPECT_EQ(at(0.6)[0], 0);
  EXPECT_EQ(at(0.6)[1], 1);
  // Two resamples have the ends between them: at 50 %, a quarter of the way from either.
  int apart = 0;
  for (uint64_t seed = 1; seed < 20; ++seed) {
    const std::array<double, 2> all =
        bootstrap(labels, false,
                  {.blocks = singles(labels), .resamples = 2, .confidence = 1 - 1e-9, .seed = seed})
            .recall_at_1;
    const std::array<double, 2> half =
        bootstrap(labels, false,
                  {.blocks = singles(labels), .resamples = 2, .confidence = 0.5, .seed = seed})
            .recall_at_1;
    apart += all[1] - all[0] > 0.4 ? 1 : 0;
    EXPECT_NEAR(half[0], 0.75 * all[0] + 0.25 * all[1], 1e-8);
    EXPECT_NEAR(half[1], 0.25 * all[0] + 0.75 * all[1], 1e-8);
  }
  EXPECT_GT(apart, 5);
}

TEST(Bootstrap, QueriesOfABlockAreDrawnTogether) {
  // 400 queries in 20 blocks, found in every fourth block: the fraction found is that of 20 draws,
  // with standard deviation sqrt(0.25 * 0.75 / 20) = 0.0968.
  std::vector<MatchLabel> labels(400, {0.5, false, true});
  std::vector<int64_t> blocks;
  for (int64_t i = 0; i < 400; ++i) {
    blocks.push_back(1000 - 7 * (i / 20));
    if (i / 20 % 4 == 0) labels[static_cast<size_t>(i)] = {1, true, true};
  }
  const auto recall = [&](const std::vector<int64_t>& of_queries) {
    return bootstrap(labels, false,
                     {.blocks = of_queries, .resamples = 20000, .confidence = 0.6827})
        .recall_at_1;
  };
  EXPECT_NEAR(recall(blocks)[0], 0.25 - 0.0968, 0.051);  // one block is 0.05
  EXPECT_NEAR(recall(blocks)[1], 0.25 + 0.0968, 0.051);
  EXPECT_NEAR(recall(singles(labels))[0], 0.25 - 0.0217, 0.0026);
  const auto [blocks_in_all, positive_blocks] =
      count_blocks({.blocks = blocks}, [](size_t query) { return query == 0; });
  EXPECT_EQ(blocks_in_all, 20);
  EXPECT_EQ(positive_blocks, 1);
}

/// Scans every `step` meters along KITTI's z.
Task straight(int n, double step, Trajectory& trajectory) {
  for (int i = 0; i < n; ++i) {
    trajectory.frames.push_back(2 * i);
    trajectory.positions.emplace_back(0, 0, step * i);
  }
  return make_tasks("online", "", trajectory, Exclusion{Exclusion::Kind::kNone, 0}).at(0);
}

TEST(Bootstrap, BlocksAreStretchesOfTheWay) {
  Trajectory trajectory;
  Task task = straight(9, 30, trajectory);  // at 0, 30, ... 240 m, all but the first are queries
  EXPECT_EQ(blocks_of(task, trajectory), (std::vector<int64_t>{0, 0, 0, 1, 1, 1, 2, 2}));
  const auto of = [&](const char* length) {
    return blocks_of(task, trajectory, parse_exclusion(length));
  };
  EXPECT_EQ(of("meters=60"), (std::vector<int64_t>{0, 1, 1, 2, 2, 3, 3, 4}));
  EXPECT_EQ(of("frames=4"), (std::vector<int64_t>{0, 1, 1, 2, 2, 3, 3, 4}));
  EXPECT_EQ(of("none"), (std::vector<int64_t>{2, 4, 6, 8, 10, 12, 14, 16}));
  EXPECT_THROW(of("meters=0"), UsageError);
  EXPECT_THROW(of("meters=1e-300"), UsageError);
  EXPECT_EQ(of("meters=1e300"), std::vector<int64_t>(8, 0));
  EXPECT_THROW(of("seconds=10"), UsageError) << "there are no times";
  trajectory.positions.clear();
  EXPECT_EQ(blocks_of(task, trajectory), std::vector<int64_t>(8, 0)) << "50 frames";
  EXPECT_THROW(of("meters=100"), UsageError);
  trajectory.places = {"a", "a", "a", "b", "b", "c", "c", "c", "c"};
  task.rule.distance = Distance::kPlace;
  EXPECT_EQ(blocks_of(task, trajectory), (std::vector<int64_t>{0, 0, 3, 3, 5, 5, 5, 5}));
}

TEST(Bootstrap, SameForAnyNumberOfThreads) {
  const std::vector<MatchLabel> labels = random_verdicts(300, 7);
  const auto with = [&](uint64_t seed, int threads) {
    return bootstrap(
        labels, true,
        {.blocks = singles(labels), .resamples = 100, .seed = seed, .threads = threads});
  };
  const PrIntervals one = with(1, 1);
  expect_same(one, with(1, 3));
  expect_same(one, with(1, 1));
  const PrIntervals other = with(2, 1);
  EXPECT_NE(one.average_precision[0], other.average_precision[0]);
  const PrIntervals large = with((1ULL << 32) + 2, 1);  // all bits of a seed count
  EXPECT_NE(large.average_precision[0], other.average_precision[0]);
}

TEST(Bootstrap, PerfectAndHopelessHaveNoWidth) {
  const PrIntervals perfect = bootstrap({{3, true, true}, {2, true, true}, {1, false, false}},
                                        false, {.blocks = {0, 1, 2}});
  const PrIntervals hopeless =
      bootstrap({{3, false, true}, {2, false, true}}, false, {.blocks = {0, 1}});
  for (const auto member : kAll) {
    EXPECT_EQ((perfect.*member)[0], 1);
    EXPECT_EQ((perfect.*member)[1], 1);
    EXPECT_EQ((hopeless.*member)[0], 0);
    EXPECT_EQ((hopeless.*member)[1], 0);
  }
}

TEST(Bootstrap, WithoutPositivesAndOfOneBlockNothingIsComputed) {
  const std::vector<MatchLabel> one = {{1, false, false}},
                                found = {{2, true, true}, {1, false, true}};
  for (const auto& [labels, blocks] : {std::pair(std::vector<MatchLabel>{}, std::vector<int64_t>{}),
                                       {one, {0}},
                                       {found, {5, 5}}}) {
    const PrIntervals none = bootstrap(labels, false, {.blocks = blocks});
    for (const auto member : kAll) {
      EXPECT_TRUE(std::isnan((none.*member)[0]));
      EXPECT_TRUE(std::isnan((none.*member)[1]));
    }
  }
}

TEST(Bootstrap, RefusesNonsenseAndStops) {
  const std::vector<MatchLabel> labels = random_verdicts(5, 1);
  const auto with = [&](BootstrapOptions options) {
    if (options.blocks.empty()) options.blocks = singles(labels);
    return bootstrap(labels, false, options);
  };
  EXPECT_THROW(with({.blocks = {1, 2}}), UsageError);
  EXPECT_THROW(with({.resamples = 0}), UsageError);
  EXPECT_THROW(with({.confidence = 1}), UsageError);
  EXPECT_THROW(with({.confidence = std::nan("")}), UsageError);
  EXPECT_THROW(with({.threads = 0}), UsageError);
  EXPECT_THROW(with({.stop = [] { return true; }}), Interrupted);
}

}  // namespace
}  // namespace revisit
