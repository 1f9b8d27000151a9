#include <gtest/gtest.h>

#include "cli/json.h"
#include "reports.pb.h"
#include "revisit/base/error.h"
#include "small_drive.h"
#include "test_data.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;
using test::run_revisit;

class SummarizeCommand : public testing::Test {
 protected:
  /// Negative `average_precision`: none.
  std::string run(const std::string& name, double average_precision, const std::string& seed,
                  const std::string& settings = "pca: 400\n",
                  const std::string& sequence = "00") const {
    const fs::path folder = dir_ / name;
    test::write_file(folder / "metrics.json",
                     "{\"tasks\": [{\"protocol\": \"online\", \"radius_m\": 5" +
                         (average_precision < 0
                              ? ""
                              : ", \"average_precision\": " + std::to_string(average_precision) +
                                    ", \"f1_max\": 0.5") +
                         "}], \"of_a_later_version\": 1}");
    test::write_file(folder / "run.json", "{\"data\": \"/data/" + seed + "\", \"sequence\": \"" +
                                              sequence + "\", \"feature\": \"pool5\"}");
    test::write_file(folder / "config.yaml", settings);
    return folder.string() + " ";
  }
  reports::Summary summarize(const std::string& runs) const {
    const auto result = run_revisit("summarize " + runs + " --format json");
    EXPECT_EQ(result.exit_code, 0) << result.err;
    test::write_file(dir_ / "summary.json", result.out);
    reports::Summary summary;
    cli::read_report(dir_ / "summary.json", &summary);
    return summary;
  }
  const test::TempDir dir_;
};

TEST_F(SummarizeCommand, MeanAndSampleDeviation) {
  // 0.5, 0.7, 0.9: mean 0.7, squares 0.04 + 0 + 0.04, deviation sqrt(0.08 / 2) = 0.2.
  const auto summary = summarize(run("a", 0.5, "1") + run("b", 0.7, "2") + run("c", 0.9, "3"));
  ASSERT_EQ(summary.rows_size(), 1);
  const reports::SummaryRow& row = summary.rows(0);
  EXPECT_EQ(row.protocol(), "online");
  EXPECT_EQ(row.sequence(), "00");
  EXPECT_EQ(row.feature(), "pool5");
  EXPECT_EQ(row.settings(), "");
  EXPECT_EQ(row.runs(), 3);
  EXPECT_NEAR(row.average_precision().mean(), 0.7, 1e-12);
  EXPECT_NEAR(row.average_precision().deviation(), 0.2, 1e-12);
  EXPECT_EQ(row.f1_max().deviation(), 0);
  EXPECT_FALSE(row.has_recall_at_1());
  EXPECT_EQ(row.folders_size(), 3);
}

TEST_F(SummarizeCommand, RunsWithoutTheValueDoNotCount) {
  const auto summary = summarize(run("a", 0.5, "1") + run("b", -1, "2"));
  EXPECT_EQ(summary.rows(0).runs(), 2);
  EXPECT_EQ(summary.rows(0).average_precision().runs(), 1);
  EXPECT_EQ(summary.rows(0).average_precision().mean(), 0.5);
  EXPECT_FALSE(summary.rows(0).average_precision().has_deviation());
}

TEST_F(SummarizeCommand, RunsWithFormerNamesOfOptionsAreReadAsThoseOfNow) {
  const auto summary =
      summarize(run("old", 0.5, "1", "other-beyond: 10\nring-key-candidates: 50\npca-fit: map\n") +
                run("new", 0.7, "2", "negative-radius: 10\ncandidates: 50\nfit-on: map\n"));
  ASSERT_EQ(summary.rows_size(), 1);
  EXPECT_EQ(summary.rows(0).runs(), 2);
}

TEST_F(SummarizeCommand, DifferentSettingsAreDifferentRows) {
  const auto summary = summarize(run("a", 0.5, "1", "pca: 100\nk: 4\n") +
                                 run("b", 0.7, "1", "pca: 400\nk: 4\nbootstrap: 0\n") +
                                 run("c", 0.9, "2", "pca: 400\nk: 4\nbootstrap: 9\n"));
  ASSERT_EQ(summary.rows_size(), 2);
  EXPECT_EQ(summary.rows(0).settings(), "pca=100");
  EXPECT_EQ(summary.rows(0).runs(), 1);
  EXPECT_EQ(summary.rows(1).settings(), "pca=400");
  EXPECT_EQ(summary.rows(1).runs(), 2);
}

TEST_F(SummarizeCommand, OverSequencesADataSetCountsOnceADrive) {
  const std::string runs = run("a", 0.5, "kitti", "pca: 400\nsequence: 00\n", "00") +
                           run("b", 0.7, "kitti", "pca: 400\nsequence: 05\n", "05") +
                           run("c", 0.9, "kitti", "pca: 400\nsequence: 06\n", "06");
  EXPECT_EQ(summarize(runs).rows_size(), 3);
  const auto summary = summarize("--over-sequences " + runs);
  ASSERT_EQ(summary.rows_size(), 1);
  EXPECT_EQ(summary.rows(0).sequence(), "00 05 06");
  EXPECT_EQ(summary.rows(0).runs(), 3);
  EXPECT_NEAR(summary.rows(0).average_precision().mean(), 0.7, 1e-12);
  EXPECT_NEAR(summary.rows(0).average_precision().deviation(), 0.2, 1e-12);
  const std::string again = run("d", 0.9, "kitti", "pca: 400\nsequence: 06\n", "06");
  EXPECT_EQ(run_revisit("summarize --over-sequences " + runs + again).exit_code, 2);
}

TEST_F(SummarizeCommand, LatestAndItsFolderAreOneRun) {
  const std::string a = run("a", 0.5, "1");
  fs::create_directory_symlink(dir_ / "a", dir_ / "latest");
  EXPECT_EQ(summarize(a + (dir_ / "latest").string()).rows(0).runs(), 1);
}

TEST_F(SummarizeCommand, TheSameDataTwiceIsRefused) {
  const auto result = run_revisit("summarize " + run("a", 0.5, "1") + run("b", 0.5, "1"));
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_NE(result.err.find("/data/1"), std::string::npos) << result.err;
}

TEST_F(SummarizeCommand, SaysWhatIsWrong) {
  EXPECT_EQ(run_revisit("summarize").exit_code, 2);
  EXPECT_EQ(run_revisit("summarize " + run("a", 0.5, "1") + " --format xml").exit_code, 2);
  EXPECT_EQ(run_revisit("summarize " + (dir_ / "none").string()).exit_code, 3);
  const auto no_run = run_revisit("summarize " + dir_.path().string());
  EXPECT_EQ(no_run.exit_code, 3);
  EXPECT_NE(no_run.err.find("metrics.json"), std::string::npos) << no_run.err;
  const std::string a = run("a", 0.5, "1");
  test::write_file(dir_ / "a/metrics.json", "{\"tasks\": [");
  EXPECT_EQ(run_revisit("summarize " + a).exit_code, 3);
}

TEST_F(SummarizeCommand, TakesWhatEvalWrites) {
  std::string folders;
  for (const char* name : {"one", "two"}) {
    test::write_small_drive(dir_ / name);
    const auto eval =
        run_revisit("eval " + (dir_ / name).string() +
                    " --feature data --geometry width=400 --protocol online,ssc --exclusion "
                    "frames=8 --no-report --bootstrap 0 -o " +
                    (dir_ / "results").string());
    ASSERT_EQ(eval.exit_code, 0) << eval.err;
    folders += (dir_ / "results" / (std::string(name) + "_00/latest")).string() + " ";
  }
  const auto summary = summarize(folders);
  ASSERT_EQ(summary.rows_size(), 2);
  EXPECT_EQ(summary.rows(0).runs(), 2);
  EXPECT_EQ(summary.rows(0).average_precision().deviation(), 0);  // equal drives
  EXPECT_EQ(summary.rows(1).protocol(), "ssc");
  EXPECT_FALSE(summary.rows(1).has_recall_at_1());
  EXPECT_NE(run_revisit("summarize " + folders).out.find("online"), std::string::npos);
}

}  // namespace
}  // namespace revisit
