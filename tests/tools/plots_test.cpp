#include "plots/plots.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "plots/metrics_report.h"
#include "revisit/proto/error.h"
#include "test_data.h"

namespace revisit::cli {
namespace {

using pipeline::Match;
using pipeline::Task;
using pipeline::Trajectory;
using pipeline::Verdict;

bool have_gnuplot() {
  return std::system("gnuplot --version >/dev/null 2>&1") == 0;
}

/// Width and height from the PNG's first chunk; {0, 0} when it is none.
std::pair<int, int> png_size(const std::filesystem::path& file) {
  const std::string bytes = test::read_file(file);
  if (bytes.size() < 24 || bytes.compare(1, 3, "PNG") != 0) return {0, 0};
  const auto number = [&](size_t at) {
    int value = 0;
    for (size_t i = 0; i < 4; ++i) value = value * 256 + static_cast<unsigned char>(bytes[at + i]);
    return value;
  };
  return {number(16), number(20)};
}

void expect_drawn(const PlotFiles& plot) {
  EXPECT_EQ(plot.warning, "");
  EXPECT_EQ(png_size(plot.png).first, 1200);
  EXPECT_NE(test::read_file(plot.svg).find("</svg>"), std::string::npos);
}

const std::vector<Verdict> kVerdicts = {
    {0.9, true, true}, {0.8, false, false}, {0.7, true, true}, {0.1, false, true}};
const std::vector<bool> kAccepted = {true, true, true, false};

/// A square drive; scans 0 and 1 are stored, four queries.
struct Drive {
  Trajectory trajectory;
  Task task;
  std::vector<Match> matches;
  Drive() {
    for (int i = 0; i < 6; ++i) {
      trajectory.frames.push_back(i);
      trajectory.positions.emplace_back(10 * (i % 2), 0, 10 * (i / 2));
    }
    task.stored = {0, 1};
    for (int i = 2; i < 6; ++i) {
      task.queries.push_back({i, {pipeline::CandidateRange{0, 2}, {}}});
      matches.push_back({i, {i % 2}, {0.5}, kVerdicts[static_cast<size_t>(i - 2)].score, 1});
    }
  }
};

TEST(Plots, PrecisionRecall) {
  const test::TempDir dir;
  const auto curve = pipeline::precision_recall(kVerdicts);
  const PlotFiles plot = plot_precision_recall(
      dir.path(), "pr", "it's a \"title\" `echo no`",
      {{"one", curve, 0.5}, {"none", {}, std::nan("")}, {"two", curve, 0.25}});
  const std::string script = test::read_file(plot.script);
  EXPECT_NE(script.find("'one (AP 0.500)'"), std::string::npos) << script;
  EXPECT_NE(script.find("none (no true match to find)"), std::string::npos) << script;
  EXPECT_NE(script.find("'it''s a \"title\" `echo no`'"), std::string::npos) << script;
  EXPECT_NE(test::read_file(plot.data).find("0 1 0.9\n"), std::string::npos);
  if (have_gnuplot()) expect_drawn(plot);
}

TEST(Plots, TrajectoryCountsEachOutcome) {
  const test::TempDir dir;
  const Drive d;
  const PlotFiles plot = plot_trajectory(dir.path(), "map", "drive", d.trajectory, d.task,
                                         d.matches, kVerdicts, kAccepted);
  const std::string script = test::read_file(plot.script);
  for (const char* legend : {"queries (4)", "stored (2)", "right (2)", "wrong (1)", "missed (1)"})
    EXPECT_NE(script.find(legend), std::string::npos) << legend << "\n" << script;
  EXPECT_NE(test::read_file(plot.data).find("0 10 0 0\n"),
            std::string::npos);  // query 2 -> stored 0
  if (have_gnuplot()) expect_drawn(plot);
  EXPECT_THROW(plot_trajectory(dir.path(), "map", "", {}, d.task, d.matches, kVerdicts, kAccepted),
               UsageError);
  EXPECT_THROW(plot_trajectory(dir.path(), "map", "", d.trajectory, d.task, {}, kVerdicts, {}),
               Error);
}

TEST(Plots, ThePathIsALineButForJumps) {
  const test::TempDir dir;
  Drive d;
  d.trajectory.positions[3].z() += 100;
  const PlotFiles plot =
      plot_trajectory(dir.path(), "map", "", d.trajectory, d.task, d.matches, kVerdicts, kAccepted);
  const std::string data = test::read_file(plot.data);
  const std::string path = "\n0 0\n10 0\n0 10\n\n10 110\n\n0 20\n10 20\n\n\n";
  EXPECT_EQ(data.substr(data.find('\n'), path.size()), path) << data;
  EXPECT_NE(test::read_file(plot.script).find("'map.dat' index 0 using 1:2 with lines"),
            std::string::npos);
}

TEST(Plots, ScoresOfTrueAndFalse) {
  const test::TempDir dir;
  const PlotFiles plot = plot_scores(dir.path(), "scores", "scores", kVerdicts, 0.75);
  EXPECT_NE(test::read_file(plot.script).find("match true (2)"), std::string::npos);
  if (have_gnuplot()) expect_drawn(plot);
}

TEST(Plots, ScoresOfPairs) {
  const test::TempDir dir;
  pipeline::ScoreHistogram histogram;
  histogram.low = -1;
  histogram.width = 2.0 / pipeline::ScoreHistogram::kBins;
  histogram.of_true[59] = 3;
  histogram.of_false[0] = 1;
  histogram.of_false[1] = 4;
  const PlotFiles plot = plot_pair_scores(dir.path(), "scores", "pairs", histogram, 0.75);
  EXPECT_NE(test::read_file(plot.script).find("pair not true (5)"), std::string::npos);
  EXPECT_NE(test::read_file(plot.script).find("pair true (3)"), std::string::npos);
  // -1 + 1.5 / 30: 4 of the 5 false ones.
  EXPECT_NE(test::read_file(plot.data).find("\n-0.95 80 0\n"), std::string::npos);
  if (have_gnuplot()) expect_drawn(plot);
}

TEST(Plots, NothingToDrawIsStillAPicture) {
  if (!have_gnuplot()) GTEST_SKIP() << "gnuplot absent";
  const test::TempDir dir;
  expect_drawn(plot_precision_recall(dir.path(), "a", "", {}));
  expect_drawn(plot_precision_recall(dir.path(), "b", "", {{"none", {}, std::nan("")}}));
  expect_drawn(plot_scores(dir.path(), "c", "", {}, std::nan("")));
  expect_drawn(plot_scores(dir.path(), "d", "", {{1, true, true}, {1, true, true}}, 1));
  const Drive d;
  expect_drawn(plot_trajectory(dir.path(), "e", "", d.trajectory, d.task, {}, {}, {}));
  Trajectory still = d.trajectory;
  for (auto& position : still.positions) position.setZero();
  expect_drawn(
      plot_trajectory(dir.path(), "f", "", still, d.task, d.matches, kVerdicts, kAccepted));
}

TEST(Plots, WithoutGnuplotDataAndScriptRemain) {
  const test::TempDir dir;
  const std::string path = std::getenv("PATH");
  ::setenv("PATH", "/does/not/exist", 1);
  const PlotFiles plot = plot_scores(dir.path(), "scores", "", kVerdicts, 0);
  ::setenv("PATH", path.c_str(), 1);
  EXPECT_NE(plot.warning.find("gnuplot is not installed"), std::string::npos) << plot.warning;
  EXPECT_TRUE(std::filesystem::exists(plot.data));
  EXPECT_TRUE(std::filesystem::exists(plot.script));
  EXPECT_FALSE(std::filesystem::exists(plot.png));
}

TEST(Plots, APictureCutOffByAFullDiskIsNoticed) {
  // A gnuplot that ends well and leaves what a full disk leaves.
  const test::TempDir dir;
  test::write_file(dir / "bin/gnuplot",
                   "#!/bin/sh\nprintf '\\211PNG...' > scores.png\n: > scores.svg\n");
  std::filesystem::permissions(dir / "bin/gnuplot", std::filesystem::perms::owner_all);
  const std::string path = std::getenv("PATH");
  ::setenv("PATH", (dir / "bin").c_str(), 1);
  const PlotFiles plot = plot_scores(dir.path(), "scores", "", kVerdicts, 0);
  ::setenv("PATH", path.c_str(), 1);
  EXPECT_NE(plot.warning.find("is the disk full?"), std::string::npos) << plot.warning;
  EXPECT_FALSE(std::filesystem::exists(plot.png));
  EXPECT_FALSE(std::filesystem::exists(plot.svg));
}

TEST(Plots, FolderThatCannotBeWrittenIsAnError) {
  EXPECT_THROW(plot_scores("/proc/none", "scores", "", kVerdicts, 0), Error);
}

TEST(MetricsReport, LeavesOutWhatWasNotComputed) {
  Task task;
  task.name = "online";
  task.exclusion = pipeline::parse_exclusion("frames=50");
  const auto some = metrics_report(pipeline::summarize(kVerdicts), task,
                                   {pipeline::Distance::kBox, 3}, "poses/00.txt");
  EXPECT_EQ(some.protocol(), "online");
  EXPECT_EQ(some.distance(), "box");
  EXPECT_EQ(some.exclusion(), "frames=50");
  EXPECT_EQ(some.n_positives(), 3);
  EXPECT_DOUBLE_EQ(some.recall_at_1(), 2.0 / 3);
  EXPECT_EQ(some.decision(), "query");
  EXPECT_FALSE(some.has_n_pairs());
  EXPECT_FALSE(some.has_false_beyond_m());
  const auto none = metrics_report(pipeline::summarize({}), task, task.rule, "");
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
  add_intervals(metrics, {{0.1, 0.2}, {0.3, 0.4}, {nan, nan}, {0.5, 0.6}, {0.7, 0.8}}, 500);
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
  task.decision = pipeline::Decision::kPair;
  pipeline::PrSummary summary;
  summary.n_pairs = 1010;
  summary.n_true_pairs = 10;
  summary.recall_at_1 = std::nan("");
  const auto metrics = metrics_report(summary, task, {pipeline::Distance::kXz, 3, 20}, "");
  EXPECT_EQ(metrics.decision(), "pair");
  EXPECT_EQ(metrics.n_pairs(), 1010);
  EXPECT_EQ(metrics.n_true_pairs(), 10);
  EXPECT_EQ(metrics.false_beyond_m(), 20);
  EXPECT_FALSE(metrics.has_recall_at_1());
}

}  // namespace
}  // namespace revisit::cli
