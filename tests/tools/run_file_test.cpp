#include "eval/run_folder.h"
#include "testing.h"

namespace revisit::cli {
namespace {

const std::vector<MatchLabel> kLabels = {
    {0.9, true, true}, {0.8, false, false}, {0.7, true, true}, {0.1, false, true}};

TEST(MetricsReport, OmitsMetricsThatAreNaN) {
  Task task;
  task.name = "online";
  task.exclusion = parse_exclusion("frames=50");
  task.rule = {Distance::kBox, 3};
  const auto some = metrics_report(summarize(kLabels), task, "poses/00.txt");
  EXPECT_EQ(some.protocol(), "online");
  EXPECT_EQ(some.distance(), "box");
  EXPECT_EQ(some.exclusion(), "frames=50");
  EXPECT_EQ(some.n_positives(), 3);
  EXPECT_DOUBLE_EQ(some.recall_at_1(), 2.0 / 3);
  EXPECT_EQ(some.decision(), "query");
  EXPECT_FALSE(some.has_n_pairs());
  EXPECT_FALSE(some.has_negative_radius_m());
  const auto none = metrics_report(summarize({}), task, "");
  EXPECT_EQ(none.n_queries(), 0);
  EXPECT_FALSE(none.has_f1_max());
  EXPECT_FALSE(none.has_average_precision());
  EXPECT_FALSE(none.has_recall_at_1());
  EXPECT_FALSE(none.has_max_recall_at_precision_1());
  EXPECT_FALSE(none.has_extended_precision());
}

TEST(MetricsReport, IntervalsAreLowAndHigh) {
  reports::Metrics metrics;
  const double nan = std::nan("");
  add_intervals(metrics, {{0.1, 0.2}, {0.3, 0.4}, {nan, nan}, {0.5, 0.6}, {0.7, 0.8}}, 500, 12);
  EXPECT_EQ(metrics.bootstrap_resamples(), 500);
  ASSERT_EQ(metrics.f1_max_ci_size(), 2);
  EXPECT_EQ(metrics.f1_max_ci(0), 0.1);
  EXPECT_EQ(metrics.average_precision_ci(1), 0.4);
  EXPECT_EQ(metrics.recall_at_1_ci_size(), 0);
  EXPECT_EQ(metrics.max_recall_at_precision_1_ci(0), 0.5);
  EXPECT_EQ(metrics.extended_precision_ci(1), 0.8);
}

TEST(MetricsReport, PairsHaveTheirCounts) {
  Task task;
  task.decides_on_pairs = true;
  task.rule = {Distance::kXz, 3, 20};
  PrSummary summary;
  summary.n_pairs = 1010;
  summary.n_correct_pairs = 10;
  summary.recall_at_1 = std::nan("");
  const auto metrics = metrics_report(summary, task, "");
  EXPECT_EQ(metrics.decision(), "pair");
  EXPECT_EQ(metrics.n_pairs(), 1010);
  EXPECT_EQ(metrics.n_correct_pairs(), 10);
  EXPECT_EQ(metrics.negative_radius_m(), 20);
  EXPECT_FALSE(metrics.has_recall_at_1());
}

TEST(DrawnCurve, KeepsTheEndsAndDropsInvisiblePoints) {
  std::vector<PrPoint> curve;
  for (int i = 0; i <= 10000; ++i) {
    PrPoint point;
    point.threshold = 1 - i * 1e-4;
    point.recall = i * 1e-4;
    point.precision = 1 - i * 0.5e-4;
    curve.push_back(point);
  }
  const auto drawn = drawn_curve(curve).recall();
  EXPECT_LE(drawn.size(), 601);
  EXPECT_GE(drawn.size(), 200);
  EXPECT_EQ(drawn.Get(0), 0);
  EXPECT_EQ(drawn.Get(drawn.size() - 1), 1);
  EXPECT_TRUE(std::ranges::is_sorted(drawn));
  for (PrPoint& point : curve) point.recall = std::nan("");
  EXPECT_EQ(drawn_curve(curve).recall_size(), 0);
}

}  // namespace
}  // namespace revisit::cli
