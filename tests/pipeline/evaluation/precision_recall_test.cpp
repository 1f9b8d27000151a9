#include "revisit/evaluation/precision_recall.h"

#include "decision_cases.h"
#include "testing.h"

namespace revisit {
namespace {

// score, correct, positive: three of the four positives are found.
const std::vector<MatchLabel> kByHand = {{0.9, true, true}, {0.8, false, false},
                                         {0.7, true, true}, {0.6, false, true},
                                         {0.5, true, true}, {0.4, false, false}};

TEST(PrecisionRecall, CurveByHand) {
  const std::vector<PrPoint> curve = precision_recall(kByHand);
  ASSERT_EQ(curve.size(), 6u);
  const int64_t expected[6][4] = {{1, 0, 3, 2}, {1, 1, 3, 1}, {2, 1, 2, 1},
                                  {2, 2, 2, 1}, {3, 2, 1, 1}, {3, 3, 1, 0}};
  for (size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(curve[i].threshold, kByHand[i].score);
    EXPECT_EQ(curve[i].tp, expected[i][0]) << i;
    EXPECT_EQ(curve[i].fp, expected[i][1]) << i;
    EXPECT_EQ(curve[i].fn, expected[i][2]) << i;
    EXPECT_EQ(curve[i].tn, expected[i][3]) << i;
  }
  EXPECT_DOUBLE_EQ(curve[4].precision, 3.0 / 5);
  EXPECT_DOUBLE_EQ(curve[4].recall, 3.0 / 4);
  EXPECT_DOUBLE_EQ(curve[4].f1, 6.0 / 9);
}

TEST(PrecisionRecall, SummaryByHand) {
  const PrSummary s = summarize(kByHand);
  EXPECT_EQ(s.n_queries, 6);
  EXPECT_EQ(s.n_positives, 4);
  EXPECT_DOUBLE_EQ(s.f1_max, 2.0 / 3);
  EXPECT_EQ(s.f1_max_threshold, 0.5);
  EXPECT_DOUBLE_EQ(s.average_precision, (1.0 + 2.0 / 3 + 3.0 / 5) / 4);
  EXPECT_DOUBLE_EQ(s.recall_at_1, 0.75);
  EXPECT_DOUBLE_EQ(s.max_recall_at_precision_1, 0.25);
  EXPECT_DOUBLE_EQ(s.extended_precision, (1 + 0.25) / 2);
}

TEST(PrecisionRecall, EqualScoresAreOneThreshold) {
  for (const bool first : {true, false}) {
    const std::vector<MatchLabel> labels = {{1, first, true}, {1, !first, true}, {0, true, true}};
    const std::vector<PrPoint> curve = precision_recall(labels);
    ASSERT_EQ(curve.size(), 2u);
    EXPECT_EQ(curve[0].tp, 1);
    EXPECT_EQ(curve[0].fp, 1);
    EXPECT_EQ(summarize(labels).max_recall_at_precision_1, 0);
    EXPECT_DOUBLE_EQ(summarize(labels).extended_precision, 0.25);
    EXPECT_DOUBLE_EQ(summarize(labels).average_precision, 1.0 / 3 * 0.5 + 1.0 / 3 * (2.0 / 3));
  }
}

TEST(PrecisionRecall, PerfectAndHopeless) {
  const PrSummary perfect = summarize({{3, true, true}, {2, true, true}, {1, false, false}});
  for (const double value : {perfect.f1_max, perfect.average_precision, perfect.recall_at_1,
                             perfect.max_recall_at_precision_1, perfect.extended_precision})
    EXPECT_EQ(value, 1);
  const PrSummary hopeless = summarize({{3, false, true}, {2, false, true}});
  for (const double value : {hopeless.f1_max, hopeless.average_precision, hopeless.recall_at_1,
                             hopeless.max_recall_at_precision_1, hopeless.extended_precision})
    EXPECT_EQ(value, 0);
}

TEST(PrecisionRecall, WithoutPositivesNothingIsComputed) {
  for (const std::vector<MatchLabel>& labels : {std::vector<MatchLabel>{}, {{1, false, false}}}) {
    const PrSummary s = summarize(labels);
    for (const double value : {s.f1_max, s.f1_max_threshold, s.average_precision, s.recall_at_1,
                               s.max_recall_at_precision_1, s.extended_precision})
      EXPECT_TRUE(std::isnan(value));
  }
  EXPECT_TRUE(std::isnan(precision_recall({{1, false, false}})[0].recall));
}

/// Reference: the definitions of the header.
PrPoint slow_point(const std::vector<MatchLabel>& labels, double threshold) {
  PrPoint p{threshold, 0, 0, 0, 0, 0, 0, 0};
  for (const MatchLabel& v : labels) {
    const bool accepted = v.score >= threshold;
    const bool is_tp = accepted && v.correct;
    p.tp += is_tp;
    p.fp += accepted && !v.correct;
    p.fn += v.positive && !is_tp;
    p.tn += !accepted && !v.positive;
  }
  p.precision = static_cast<double>(p.tp) / static_cast<double>(p.tp + p.fp);
  p.recall = static_cast<double>(p.tp) / static_cast<double>(p.tp + p.fn);
  return p;
}

TEST(PrecisionRecall, AgreesWithTheSlowTwin) {
  for (unsigned seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    std::vector<MatchLabel> labels(1 + random() % 60);
    for (MatchLabel& v : labels) {
      v.positive = random() % 2;
      v.correct = v.positive && random() % 3;
      v.score = static_cast<double>(random() % 20) / 7;  // many ties
    }
    labels[0].positive = true;
    std::set<double, std::greater<>> thresholds;
    for (const MatchLabel& v : labels) thresholds.insert(v.score);
    const std::vector<PrPoint> curve = precision_recall(labels);
    ASSERT_EQ(curve.size(), thresholds.size());
    size_t i = 0;
    for (const double threshold : thresholds) {
      const PrPoint slow = slow_point(labels, threshold), &fast = curve[i++];
      EXPECT_EQ(fast.threshold, threshold);
      EXPECT_EQ(fast.tp, slow.tp);
      EXPECT_EQ(fast.fp, slow.fp);
      EXPECT_EQ(fast.fn, slow.fn);
      EXPECT_EQ(fast.tn, slow.tn);
      EXPECT_EQ(fast.precision, slow.precision);
      EXPECT_EQ(fast.recall, slow.recall);
      if (slow.tp > 0) {
        const double f1 = 2 * slow.precision * slow.recall / (slow.precision + slow.recall);
        EXPECT_NEAR(fast.f1, f1, 1e-12);
      }
    }
    EXPECT_EQ(summarize(labels).recall_at_1, slow_point(labels, -1).recall);
  }
}

TEST(PrecisionRecall, AgreesWithScikitLearn) {
  const auto cases = test::decision_cases();
  ASSERT_EQ(cases.size(), 7u);
  for (const auto& [name, one] : cases) {
    SCOPED_TRACE(name);
    std::vector<MatchLabel> labels;
    for (const auto& [score, label] : one.decisions) labels.push_back({score, label, label});
    const std::vector<PrPoint> curve = precision_recall(labels);
    ASSERT_EQ(curve.size(), one.curve.size());
    for (size_t i = 0; i < curve.size(); ++i) {
      EXPECT_EQ(curve[i].threshold, one.curve[i].threshold);
      EXPECT_DOUBLE_EQ(curve[i].precision, one.curve[i].precision);
      EXPECT_DOUBLE_EQ(curve[i].recall, one.curve[i].recall);
    }
    const PrSummary s = summarize(labels);
    EXPECT_NEAR(s.average_precision, one.average_precision, 1e-12);
    EXPECT_NEAR(s.f1_max, one.f1_max, 1e-12);
    EXPECT_NEAR(s.max_recall_at_precision_1, one.max_recall_at_precision_1, 1e-12);
    EXPECT_NEAR(s.extended_precision, one.extended_precision, 1e-12);

    // Half of the positives are accepted with an incorrect match: scikit-learn's recall is over the
    // found ones, ours over all positives.
    int64_t n_found = 0, n_positives = 0;
    for (const MatchLabel& v : labels) n_found += v.correct;
    for (size_t i = 0; i < labels.size(); ++i) {
      labels[i].positive |= i % 2 == 0;
      n_positives += labels[i].positive;
    }
    EXPECT_NEAR(
        summarize(labels).average_precision,
        one.average_precision * static_cast<double>(n_found) / static_cast<double>(n_positives),
        1e-12);
  }
}

// The best match of the first and of the fourth query is ignored; the third accepts an incorrect
// match although there is a true one.
const std::vector<MatchLabel> kOnlyRejectedMissed = {
    {0.9, false, true, true},  {0.8, true, true, false}, {0.7, false, true, false},
    {0.6, false, false, true}, {0.5, true, true, false}, {0.4, false, false, false}};

TEST(PrecisionRecall, OnlyRejectedPositivesMissedByHand) {
  const std::vector<PrPoint> curve = precision_recall(kOnlyRejectedMissed, true);
  ASSERT_EQ(curve.size(), 6u);
  // tp, fp, fn (the rejected of the 4 positives), tn
  const int64_t expected[6][4] = {{0, 0, 3, 2}, {1, 0, 2, 2}, {1, 1, 1, 2},
                                  {1, 1, 1, 1}, {2, 1, 0, 1}, {2, 2, 0, 0}};
  for (size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(curve[i].tp, expected[i][0]) << i;
    EXPECT_EQ(curve[i].fp, expected[i][1]) << i;
    EXPECT_EQ(curve[i].fn, expected[i][2]) << i;
    EXPECT_EQ(curve[i].tn, expected[i][3]) << i;
  }
  EXPECT_TRUE(std::isnan(curve[0].precision));  // all accepted matches are ignored
  EXPECT_EQ(curve[0].recall, 0);
  EXPECT_EQ(curve[0].f1, 0);

  const PrSummary s = summarize(kOnlyRejectedMissed, true);
  EXPECT_DOUBLE_EQ(s.f1_max, 4.0 / 5);  // at 0.5: 2 tp 4, fp 1, fn 0
  EXPECT_EQ(s.f1_max_threshold, 0.5);
  // Recall 1/3 at precision 1, then 1/2 at 1/2, then 1 at 2/3.
  EXPECT_DOUBLE_EQ(s.average_precision,
                   1.0 / 3 + (1.0 / 2 - 1.0 / 3) / 2 + (1 - 1.0 / 2) * 2.0 / 3);
  EXPECT_DOUBLE_EQ(s.recall_at_1, 2.0 / 4);  // over all positives all the same
  EXPECT_DOUBLE_EQ(s.max_recall_at_precision_1, 1.0 / 3);
  EXPECT_DOUBLE_EQ(s.extended_precision, (1 + 1.0 / 3) / 2);
}

TEST(PrecisionRecall, IgnoredMatchesAreNoFalsePositives) {
  // Every miss counts: fn = 3 - tp throughout, as one of four matches is ignored.
  const PrSummary s = summarize(kOnlyRejectedMissed);
  EXPECT_DOUBLE_EQ(s.f1_max, 4.0 / (4 + 1 + 1));
  EXPECT_DOUBLE_EQ(s.average_precision, 1.0 / 3 + 1.0 / 3 * 2 / 3);
  const std::vector<MatchLabel> nothing_counts = {{0.9, false, true, true},
                                                  {0.8, false, true, true}};
  for (const bool missed : {false, true}) {
    const PrSummary none = summarize(nothing_counts, missed);
    EXPECT_EQ(none.recall_at_1, 0);
    if (missed) {
      EXPECT_EQ(none.f1_max, 0);
      EXPECT_EQ(none.average_precision, 0);
    } else {
      EXPECT_TRUE(std::isnan(none.average_precision)) << "no positive is judged";
    }
    EXPECT_TRUE(std::isnan(none.f1_max_threshold));
  }
}

TEST(PrecisionRecall, AMatchThatIsNeitherRightNorWrongIsNoMiss) {
  // Three positives: the first is found, the second has an ignored match, the third is not found.
  const std::vector<MatchLabel> labels = {
      {0.9, true, true}, {0.8, false, true, true}, {0.7, false, true}};
  EXPECT_DOUBLE_EQ(summarize(labels).average_precision, 0.5);
  EXPECT_DOUBLE_EQ(summarize(labels).max_recall_at_precision_1, 0.5);
  EXPECT_DOUBLE_EQ(summarize(labels).recall_at_1, 1.0 / 3) << "the place itself was not found";
  EXPECT_EQ(summarize(labels).n_positives, 3);
  EXPECT_EQ(precision_recall(labels)[0].tn, 0) << "the second has a correct match";
  // Only rejected ones are missed: at 0.8 only the third is.
  EXPECT_DOUBLE_EQ(precision_recall(labels, true)[1].recall, 0.5);
  EXPECT_DOUBLE_EQ(precision_recall(labels, true)[0].recall, 1.0 / 3);
}

TEST(PrecisionRecall, SummaryIsThatOfTheCurve) {
  // Curve and summary are computed independently.
  for (unsigned seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    std::vector<MatchLabel> labels(1 + random() % 80);
    for (MatchLabel& v : labels) {
      v.positive = random() % 2;
      v.correct = v.positive && random() % 3;
      v.ignored = !v.correct && random() % 3 == 0;
      v.score = static_cast<double>(random() % 20) / 7;
    }
    labels[0].positive = true;
    labels[0].ignored = false;
    for (const bool missed : {false, true}) {
      double average = 0, f1_max = 0, last = 0, at_full = 0, first = std::nan("");
      for (const PrPoint& p : precision_recall(labels, missed)) {
        f1_max = std::max(f1_max, p.f1);
        if (p.fp == 0) at_full = p.recall;
        if (std::isnan(p.precision)) continue;
        if (std::isnan(first)) first = p.precision;
        average += (p.recall - last) * p.precision;
        last = p.recall;
      }
      const PrSummary s = summarize(labels, missed);
      EXPECT_NEAR(s.average_precision, average, 1e-12);
      EXPECT_NEAR(s.f1_max, f1_max, 1e-12);
      EXPECT_EQ(s.max_recall_at_precision_1, at_full);
      EXPECT_NEAR(s.extended_precision, ((std::isnan(first) ? 0 : first) + at_full) / 2, 1e-12);
    }
  }
}

TEST(PrecisionRecall, RefusesContradictions) {
  EXPECT_THROW(precision_recall({{1, true, true, true}}), Error);
  EXPECT_THROW(precision_recall({{1, true, false}}), Error);
  EXPECT_THROW(precision_recall({{std::nan(""), true, true}}), Error);
}

TEST(PrecisionRecall, JudgesAgainstTheTasksOwnCandidates) {
  Trajectory drive;
  for (const double x : {0.0, 100.0, 1.0, 101.0, 200.0, 2.0}) {
    drive.frames.push_back(static_cast<int>(drive.frames.size()));
    drive.positions.emplace_back(x, 0, 0);
  }
  Task task;
  task.name = "test";
  task.stored = {0, 1};
  const std::array<CandidateRange, 2> all{CandidateRange{0, 2}, {}},
      only_second{CandidateRange{}, {1, 2}};
  task.queries = {{2, all}, {3, all}, {4, all}, {5, only_second}};
  std::vector<Match> matches(4);
  for (size_t i = 0; i < 4; ++i) matches[i] = {task.queries[i].scan, {1}, {0.5}, 0.5, 1};
  const std::vector<MatchLabel> labels = label_matches(matches, task, drive, {Distance::kXz, 5});
  EXPECT_FALSE(labels[0].correct);
  EXPECT_TRUE(labels[0].positive);  // scan 0 was there to be found
  EXPECT_TRUE(labels[1].correct);
  EXPECT_TRUE(labels[1].positive);
  EXPECT_FALSE(labels[2].positive);
  EXPECT_FALSE(labels[3].positive);  // scan 0 is near, but not a candidate of scan 5
  // An incorrect match must be farther than 99.5 m: those of scans 2 (99 m) and 5 (98 m) are
  // neither.
  const std::vector<MatchLabel> tolerant =
      label_matches(matches, task, drive, {Distance::kXz, 5, 99.5});
  for (size_t i = 0; i < 4; ++i) EXPECT_EQ(tolerant[i].ignored, i == 0 || i == 3) << i;
  for (const MatchLabel& verdict : labels) EXPECT_FALSE(verdict.ignored);
  std::vector<Match> others = matches;
  others[1].query = 4;
  EXPECT_THROW(label_matches(others, task, drive, {}), Error);
  others = matches;
  others[1].ranks.clear();
  EXPECT_THROW(label_matches(others, task, drive, {}), Error);
  matches.pop_back();
  EXPECT_THROW(label_matches(matches, task, drive, {}), Error);
  EXPECT_THROW(label_matches(matches, task, Trajectory{}, {}), UsageError);
}

}  // namespace
}  // namespace revisit
