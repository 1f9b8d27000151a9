#include <mutex>

#include "decision_cases.h"
#include "float_matrix.h"
#include "revisit/evaluation/evaluate.h"
#include "testing.h"
#include "trajectory.h"

namespace revisit {
namespace {

Trajectory drive_along_x(const std::vector<double>& xs) {
  Trajectory drive;
  for (const double x : xs) {
    drive.frames.push_back(static_cast<int>(drive.frames.size()));
    drive.positions.emplace_back(x, 0, 0);
  }
  return drive;
}

/// Descriptors are scan numbers.
template <class Of>
Descriptors by_numbers(const Trajectory& drive, Of of) {
  Descriptors numbers{FloatMatrix(drive.size(), 1)};
  std::iota(numbers.case1.values.begin(), numbers.case1.values.end(), 0.0F);
  numbers.comparison.similarity = [of](std::span<const float> query,
                                       std::span<const std::span<const float>> places,
                                       std::span<double> similarities) {
    for (size_t i = 0; i < places.size(); ++i)
      similarities[i] = of(static_cast<int64_t>(query[0]), static_cast<int64_t>(places[i][0]));
  };
  return numbers;
}

TEST(Pairs, SscByHand) {
  // Scans and x [m]:               0  1   2   3  4   5   6
  const Trajectory drive = drive_along_x({0, 10, 30, 1, 40, 11, 12});
  const Task task = make_tasks("ssc", "", drive, parse_exclusion("frames=2")).at(0);
  // True (nearer than 3 m, more than 2 frames apart): 3-0, 5-1, 6-1; 6-5 is 1 frame apart.
  // False (farther than 20 m): 2-0 (30 m), 3-2, 4-0, 4-1, 4-3, 5-4, 6-4; 2-1 has just 20 m.
  const std::map<std::pair<int64_t, int64_t>, double> similarities = {
      {{3, 0}, 0.9375}, {{5, 1}, 0.75},  {{4, 1}, 0.75},  {{2, 0}, 0.625}, {{6, 1}, 0.5},
      {{3, 2}, 0.125},  {{4, 0}, 0.125}, {{4, 3}, 0.125}, {{5, 4}, 0.125}, {{6, 4}, 0.125}};
  // Ignored pairs must not be compared.
  const TaskResult result =
      evaluate_pairs(task, drive, by_numbers(drive, [&](int64_t q, int64_t c) {
                       return similarities.at({q, c});
                     }));
  const PrSummary& s = result.summary;
  EXPECT_EQ(s.n_pairs, 10);
  EXPECT_EQ(s.n_correct_pairs, 3);
  EXPECT_EQ(s.n_queries, 5);  // 2, 3, 4, 5, 6
  EXPECT_EQ(s.n_positives, 3);
  // 0.9375: tp 1 fp 0; 0.75: tp 2 fp 1; 0.625: fp 2; 0.5: tp 3 fp 2; 0.125: fp 7
  EXPECT_DOUBLE_EQ(s.average_precision, (1 + 2.0 / 3 + 3.0 / 5) / 3);
  EXPECT_DOUBLE_EQ(s.f1_max, 6.0 / 8);
  EXPECT_EQ(s.f1_max_threshold, 0.5);
  EXPECT_DOUBLE_EQ(s.max_recall_at_precision_1, 1.0 / 3);
  EXPECT_DOUBLE_EQ(s.extended_precision, (1 + 1.0 / 3) / 2);
  EXPECT_TRUE(std::isnan(s.recall_at_1));
  ASSERT_EQ(result.curve.size(), 4u);  // where a correct pair is added, and the end
  EXPECT_EQ(result.curve[1].tp, 2);
  EXPECT_EQ(result.curve[1].fp, 1);
  EXPECT_EQ(result.curve[1].fn, 1);
  EXPECT_EQ(result.curve[1].tn, 6);
  EXPECT_EQ(result.curve[3].fp, 7);
  EXPECT_FALSE(result.intervals);
}

TEST(Pairs, Lcdnet2ByHand) {
  // Queries are rows 2 to 4 (frame 100 on), candidates are rows more than 50 frames before them.
  Trajectory drive = drive_along_x({0, 50, 1, 51, 3});
  drive.frames = {0, 70, 110, 130, 180};
  const Task task = make_tasks("lcdnet2", "", drive).at(0);
  // Pairs: 2-0 (1 m, true), 3-0, 3-1 (1 m, true), 4-0 (3 m, true), 4-1, 4-2 (2 m, true); 2-1 is 40
  // frames apart, 4-3 exactly 50.
  std::set<std::pair<int64_t, int64_t>> seen;
  std::mutex mutex;
  const TaskResult result =
      evaluate_pairs(task, drive, by_numbers(drive, [&](int64_t q, int64_t c) {
                       const std::lock_guard lock(mutex);
                       seen.insert({q, c});
                       return static_cast<double>(10 * q + c);
                     }));
  EXPECT_EQ(seen, (std::set<std::pair<int64_t, int64_t>>{
                      {2, 0}, {3, 0}, {3, 1}, {4, 0}, {4, 1}, {4, 2}}));
  EXPECT_EQ(result.summary.n_correct_pairs, 4);
  EXPECT_EQ(result.summary.n_queries, 3);
  // By score: 42 true, 41 not, 40 true, 31 true, 30 not, 20 true.
  EXPECT_DOUBLE_EQ(result.summary.average_precision, (1 + 2.0 / 3 + 3.0 / 4 + 4.0 / 6) / 4);
  EXPECT_DOUBLE_EQ(result.summary.f1_max, 8.0 / (8 + 2));  // at 20; at 31 it is 6 / 8
}

/// One stored place; the other scans are at it (true) or far away (false).
struct OnePlace {
  Trajectory drive;
  Task task;
  explicit OnePlace(const std::vector<std::pair<double, bool>>& decisions) {
    std::vector<double> xs{0};
    for (const auto& [score, label] : decisions) xs.push_back(label ? 0 : 100);
    drive = drive_along_x(xs);
    task.name = "test";
    task.decides_on_pairs = true;
    task.rule = {Distance::kXz, 3};
    task.stored = {0};
    for (size_t i = 1; i < xs.size(); ++i)
      task.queries.push_back({static_cast<int64_t>(i), {CandidateRange{0, 1}, {}}});
  }
};

TEST(Pairs, AgreeWithScikitLearn) {
  for (const auto& [name, one] : test::decision_cases()) {
    SCOPED_TRACE(name);
    const OnePlace place(one.decisions);
    const TaskResult result =
        evaluate_pairs(place.task, place.drive, by_numbers(place.drive, [&](int64_t q, int64_t) {
                         return one.decisions[static_cast<size_t>(q - 1)].first;
                       }));
    EXPECT_NEAR(result.summary.average_precision, one.average_precision, 1e-12);
    EXPECT_NEAR(result.summary.f1_max, one.f1_max, 1e-12);
    EXPECT_NEAR(result.summary.max_recall_at_precision_1, one.max_recall_at_precision_1, 1e-12);
    EXPECT_NEAR(result.summary.extended_precision, one.extended_precision, 1e-12);
    // Each point is one of scikit-learn's complete curve.
    for (const PrPoint& p : result.curve) {
      const auto same = std::find_if(one.curve.begin(), one.curve.end(),
                                     [&](const auto& q) { return q.threshold == p.threshold; });
      ASSERT_NE(same, one.curve.end());
      EXPECT_DOUBLE_EQ(p.precision, same->precision);
      EXPECT_DOUBLE_EQ(p.recall, same->recall);
    }
  }
}

Trajectory random_drive(int64_t n, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(0, 60);
  std::vector<double> xs(static_cast<size_t>(n));
  for (double& x : xs) x = uniform(random);
  return drive_along_x(xs);
}

TEST(Pairs, AreThoseOfTheSlowTwin) {
  // Reference: all pairs as labels, with cosines in another order of operations.
  const Trajectory drive = random_drive(180, 1);
  const FloatMatrix m = random_matrix(180, 19, 2);
  for (const char* protocol : {"lcdnet2", "ssc"}) {
    SCOPED_TRACE(protocol);
    const Task task = make_tasks(protocol, "", drive, parse_exclusion("frames=20")).at(0);
    const bool ssc = task.rule.negative_radius > 0;
    std::vector<MatchLabel> labels;
    for (int64_t i = ssc ? 0 : 100; i < 180; ++i)
      for (int64_t j = 0; j < i; ++j) {
        const double d = std::abs(drive.positions[i].x() - drive.positions[j].x());
        const bool near = d < (ssc ? 3 : 4), far = ssc ? d > 20 : !near, beyond = i - j > 20;
        if (ssc ? !(far || (near && beyond)) : !beyond) continue;
        double ab = 0, aa = 0, bb = 0;
        for (int64_t k = 0; k < m.d; ++k) {
          ab += double{m.row(i)[k]} * m.row(j)[k];
          aa += double{m.row(i)[k]} * m.row(i)[k];
          bb += double{m.row(j)[k]} * m.row(j)[k];
        }
        labels.push_back({ab / std::sqrt(aa * bb), near, near});
      }
    const TaskResult result = evaluate_pairs(task, drive, {m});
    const PrSummary slow = summarize(labels), &fast = result.summary;
    EXPECT_EQ(fast.n_pairs, static_cast<int64_t>(labels.size()));
    EXPECT_EQ(fast.n_correct_pairs, slow.n_positives);
    EXPECT_NEAR(fast.average_precision, slow.average_precision, 1e-9);
    EXPECT_NEAR(fast.f1_max, slow.f1_max, 1e-9);
    EXPECT_NEAR(fast.extended_precision, slow.extended_precision, 1e-9);
  }
}

TEST(Pairs, MayBeComparedInAFeaturesOwnWay) {
  // Similarity is minus the distance of one-dimensional descriptors; one call has all candidates.
  const Trajectory drive = drive_along_x({0, 100, 1, 101, 2});
  FloatMatrix m(5, 1);
  m.values = {3, 8, 4, 9, 1};
  Task task = make_tasks("ssc", "", drive, parse_exclusion("none")).at(0);
  int64_t calls = 0;
  Comparison own;
  own.similarity = [&](std::span<const float> query, std::span<const std::span<const float>> places,
                       std::span<double> similarities) {
    for (size_t i = 0; i < places.size(); ++i)
      similarities[i] = -std::abs(double{query[0]} - places[i][0]);
    ++calls;
    if (query[0] == 1) {
      EXPECT_EQ(std::vector<double>(similarities.begin(), similarities.end()),
                (std::vector<double>{-2, -7, -3, -8}));
    }
  };
  // True: 2-0 (-1), 3-1 (-1), 4-0 (-2), 4-2 (-3); false: 1-0 (-5), 2-1 (-4), 3-0 (-6), 3-2 (-5),
  // 4-1 (-7), 4-3 (-8).
  const TaskResult result = evaluate_pairs(task, drive, {m, {}, own});
  EXPECT_EQ(calls, 4);  // for scans 1 to 4
  EXPECT_EQ(result.summary.n_correct_pairs, 4);
  EXPECT_EQ(result.summary.average_precision, 1);
  EXPECT_EQ(result.summary.f1_max_threshold, -3);
}

TEST(Pairs, NegativesAreDrawnEvenlyAndTheSameEveryTime) {
  const Trajectory drive = random_drive(400, 5);
  Task task = make_tasks("ssc", "", drive).at(0);
  const auto compared = [&](int per_positive, int threads) {
    task.negatives_per_positive = per_positive;
    std::vector<std::pair<int64_t, int64_t>> pairs;
    std::mutex mutex;
    const auto note = by_numbers(drive, [&](int64_t q, int64_t c) {
      const std::lock_guard lock(mutex);
      pairs.emplace_back(q, c);
      return 0.5;
    });
    BootstrapOptions options{.resamples = 0};
    options.threads = threads;
    const PrSummary s = evaluate_pairs(task, drive, note, options).summary;
    EXPECT_EQ(static_cast<int64_t>(pairs.size()), s.n_pairs);
    std::sort(pairs.begin(), pairs.end());
    return std::pair(pairs, s);
  };
  const auto [all, every] = compared(0, 1);
  const auto [drawn, s] = compared(2, 2);
  EXPECT_EQ(s.n_correct_pairs, every.n_correct_pairs);
  EXPECT_EQ(s.n_pairs, 3 * s.n_correct_pairs);
  ASSERT_LT(s.n_pairs, every.n_pairs / 2);
  EXPECT_TRUE(std::includes(all.begin(), all.end(), drawn.begin(), drawn.end()));
  EXPECT_EQ(std::adjacent_find(drawn.begin(), drawn.end()), drawn.end());
  EXPECT_EQ(drawn, compared(2, 1).first);
  EXPECT_EQ(compared(1 << 20, 1).first, all);  // more wanted than there are
  // The fraction of incorrect pairs in the first half of the queries is about that of all incorrect
  // pairs: within 3 standard deviations of a binomial.
  const auto count = [&](const auto& pairs, int64_t below) {
    return static_cast<double>(std::count_if(pairs.begin(), pairs.end(), [&](const auto& p) {
      return p.first < below &&
             std::abs(drive.positions[p.first].x() - drive.positions[p.second].x()) > 20;
    }));
  };
  const double share = count(all, 200) / count(all, 400), n = count(drawn, 400);
  EXPECT_EQ(n, 2 * static_cast<double>(s.n_correct_pairs));
  EXPECT_NEAR(count(drawn, 200), n * share, 3 * std::sqrt(n * share * (1 - share)));
}

constexpr Exclusion kSingle{Exclusion::Kind::kNone, 0};  // each query is a block

TEST(Pairs, SameForAnyNumberOfThreads) {
  const Trajectory drive = random_drive(300, 8);
  const FloatMatrix m = random_matrix(300, 5, 9);
  const Task task = make_tasks("lcdnet2", "", drive).at(0);
  BootstrapOptions options{.blocks = blocks_of(task, drive, kSingle), .resamples = 40};
  const TaskResult one = evaluate_pairs(task, drive, {m}, options);
  options.threads = 3;
  int64_t last = 0;
  options.progress = [&](int64_t done, int64_t) { last = done; };
  const TaskResult three = evaluate_pairs(task, drive, {m}, options);
  EXPECT_EQ(last, static_cast<int64_t>(task.queries.size()));
  EXPECT_EQ(one.summary.average_precision, three.summary.average_precision);
  EXPECT_EQ(one.intervals->average_precision[0], three.intervals->average_precision[0]);
  EXPECT_EQ(one.intervals->f1_max[1], three.intervals->f1_max[1]);
  EXPECT_LT(one.intervals->average_precision[0], one.summary.average_precision);
  EXPECT_GT(one.intervals->average_precision[1], one.summary.average_precision);
  EXPECT_TRUE(std::isnan(one.intervals->recall_at_1[0]));
  EXPECT_EQ(one.histogram->of_correct, three.histogram->of_correct);
}

TEST(Pairs, ResamplesTakeAQueryWithAllItsPairs) {
  // Two queries with three stored scans each: the first has three correct pairs, the second none. A
  // resample has 0, 3 or 6 correct pairs of its 6; with 0 nothing can be computed; AP is 1 for both
  // others as correct pairs score higher.
  const Trajectory drive = drive_along_x({0, 1, 2, 0.5, 100, 101, 102, 200});
  Task task;
  task.name = "test";
  task.decides_on_pairs = true;
  task.rule = {Distance::kXz, 3};
  task.stored = {0, 1, 2};
  task.queries = {{3, {CandidateRange{0, 3}, {}}}, {7, {CandidateRange{0, 3}, {}}}};
  const BootstrapOptions options{.blocks = blocks_of(task, drive, kSingle), .resamples = 500};
  const TaskResult result = evaluate_pairs(
      task, drive, by_numbers(drive, [](int64_t q, int64_t c) { return q == 3 && c > 0 ? 1 : 0; }),
      options);
  // The original sample: 1.0: tp 2; 0: tp 3, fp 3: AP = 2/3 + 1/3 * 1/2 = 5/6. The first query
  // twice: 1.
  EXPECT_DOUBLE_EQ(result.summary.average_precision, 5.0 / 6);
  EXPECT_DOUBLE_EQ(result.intervals->average_precision[0], 5.0 / 6);
  EXPECT_DOUBLE_EQ(result.intervals->average_precision[1], 1);
}

TEST(Pairs, CurveIsThinned) {
  const Trajectory drive = random_drive(500, 3);
  const FloatMatrix m = random_matrix(500, 7, 4);
  Task task = make_tasks("lcdnet2", "", drive).at(0);
  const TaskResult result = evaluate_pairs(task, drive, {m});
  ASSERT_GT(result.summary.n_correct_pairs, 5000);
  EXPECT_LE(result.curve.size(), 1200u);
  EXPECT_GE(result.curve.size(), 900u);
  EXPECT_EQ(result.curve.back().recall, 1);
  double largest_step = 0, last = 0;
  for (const PrPoint& p : result.curve) {
    largest_step = std::max(largest_step, p.recall - last);
    last = p.recall;
  }
  EXPECT_LT(largest_step, 0.002);
}

TEST(Pairs, HistogramCountsEveryPair) {
  const OnePlace place({{1, true}, {0.5, false}, {0, false}, {0, true}});
  const std::vector<double> scores{0, 1, 0.5, 0, 0};
  const ScoreHistogram h =
      evaluate_pairs(place.task, place.drive,
                     by_numbers(place.drive,
                                [&](int64_t q, int64_t) { return scores[static_cast<size_t>(q)]; }))
          .histogram.value();
  EXPECT_EQ(h.low, 0);
  EXPECT_DOUBLE_EQ(h.width, 1.0 / 60);
  EXPECT_EQ(h.of_correct.front(), 1);
  EXPECT_EQ(h.of_correct.back(), 1);
  EXPECT_EQ(h.of_incorrect.front(), 1);
  EXPECT_EQ(h.of_incorrect[30], 1);
  EXPECT_EQ(std::accumulate(h.of_incorrect.begin(), h.of_incorrect.end(), int64_t{0}), 2);
}

TEST(Pairs, CountsOfTheOfficialPoses) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  const auto drive = [&](const char* sequence) {
    return trajectory_of(read_kitti_poses(kitti / "poses" / str(sequence, ".txt")));
  };
  const auto zero = [](int64_t, int64_t) { return 0.0; };
  // Pair lists published with SSC have this many lines with a 1, and 100 times as many with a 0.
  const std::pair<const char*, int64_t> ssc[] = {
      {"00", 7555}, {"05", 4785}, {"06", 1578}, {"08", 1994}};
  for (const auto& [sequence, n_correct] : ssc) {
    SCOPED_TRACE(sequence);
    const Trajectory t = drive(sequence);
    const PrSummary s =
        evaluate_pairs(make_tasks("ssc", sequence, t).at(0), t, by_numbers(t, zero)).summary;
    EXPECT_EQ(s.n_correct_pairs, n_correct);
    EXPECT_EQ(s.n_pairs, 101 * n_correct);
    EXPECT_NEAR(s.average_precision, 1.0 / 101, 1e-12);  // all scores are equal
  }
  // Counted with numpy: i >= 100, j < i - 50, horizontal distance below 4 m.
  const Trajectory t = drive("06");
  const PrSummary s =
      evaluate_pairs(make_tasks("lcdnet2", "06", t).at(0), t, by_numbers(t, zero)).summary;
  EXPECT_EQ(s.n_pairs, 550550);
  EXPECT_EQ(s.n_correct_pairs, 2138);
}

TEST(Pairs, RefuseNonsense) {
  const OnePlace place({{1, true}, {0, false}});
  const auto nothing = by_numbers(place.drive, [](int64_t, int64_t) { return 0.0; });
  Task of_queries = place.task;
  of_queries.decides_on_pairs = false;
  EXPECT_THROW(evaluate_pairs(of_queries, place.drive, nothing), Error);
  EXPECT_THROW(evaluate_pairs(place.task, Trajectory{{0, 1, 2}, {}, {}}, nothing), UsageError);
  BootstrapOptions options{.resamples = 0};
  options.threads = 0;
  EXPECT_THROW(evaluate_pairs(place.task, place.drive, nothing, options), UsageError);
  for (const double bad : {std::nan(""), HUGE_VAL})
    EXPECT_THROW(evaluate_pairs(place.task, place.drive,
                                by_numbers(place.drive, [&](int64_t, int64_t) { return bad; })),
                 Error);
  options.threads = 1;
  options.stop = [] { return true; };
  EXPECT_THROW(evaluate_pairs(place.task, place.drive, nothing, options), Interrupted);
  FloatMatrix m = random_matrix(3, 2, 1);
  m.row(1)[1] = std::nanf("");
  expect_error<Error>([&] { evaluate_pairs(place.task, place.drive, {m}); }, {"scan 1", "case 1"});
  EXPECT_THROW(evaluate_pairs(place.task, place.drive, {random_matrix(4, 2, 1)}), Error);
}

TEST(Pairs, TooManyAreRefusedBeforeTheyAreCompared) {
  // 16,385 scans: 2^27 pairs and 8192 more.
  const std::vector<double> xs(16385, 0.0);
  const Trajectory drive = drive_along_x(xs);
  Task task = make_tasks("ssc", "", drive, parse_exclusion("none")).at(0);
  EXPECT_THROW(evaluate_pairs(task, drive,
                              by_numbers(drive,
                                         [](int64_t, int64_t) -> double {
                                           throw std::logic_error("compared");
                                         })),
               UsageError);
}

}  // namespace
}  // namespace revisit
