#include "cli/json.h"
#include "reports.pb.h"
#include "small_drive.h"
#include "testing.h"

namespace revisit {
namespace {

class Summary : public testing::Test {
 protected:
  /// Negative `average_precision`: none. `settings`: members of a JSON object.
  std::string run(const std::string& name, double average_precision, const std::string& seed,
                  const std::string& settings = "\"pca\": \"400\"",
                  const std::string& sequence = "00") const {
    const std::string figures =
        average_precision < 0
            ? ""
            : ", \"average_precision\": " + std::to_string(average_precision) + ", \"f1_max\": 0.5";
    write_file(dir_ / name / "run.json",
               "{\"tasks\": [{\"metrics\": {\"protocol\": \"online\", \"radius_m\": 5" + figures +
                   "}}], \"of_a_later_version\": 1, \"info\": {\"data\": \"/data/" + seed +
                   "\", \"sequence\": \"" + sequence +
                   "\", \"feature\": \"pool5\"}, \"configuration\": {" + settings + "}}");
    return (dir_ / name).string() + " ";
  }
  test::ProgramResult report(const std::string& runs) const {
    return run_revisit("report " + runs + " -o " + (dir_ / "r.html").string());
  }
  reports::Summary summarize(const std::string& runs) const {
    const auto result = report(runs + " --format json");
    EXPECT_EQ(result.exit_code, 0) << result.err;
    reports::Summary summary;
    cli::parse_report(result.out, "summary", &summary);
    return summary;
  }
  const TempDir dir_;
};

TEST_F(Summary, MeanAndSampleDeviation) {
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

TEST_F(Summary, RunsWithoutTheValueDoNotCount) {
  const auto summary = summarize(run("a", 0.5, "1") + run("b", -1, "2"));
  EXPECT_EQ(summary.rows(0).runs(), 2);
  EXPECT_EQ(summary.rows(0).average_precision().runs(), 1);
  EXPECT_EQ(summary.rows(0).average_precision().mean(), 0.5);
  EXPECT_FALSE(summary.rows(0).average_precision().has_deviation());
}

TEST_F(Summary, DifferentSettingsAreDifferentRows) {
  const auto summary =
      summarize(run("a", 0.5, "1", "\"pca\": \"100\", \"k\": \"4\"") +
                run("b", 0.7, "1", "\"pca\": \"400\", \"k\": \"4\", \"bootstrap\": \"0\"") +
                run("c", 0.9, "2", "\"pca\": \"400\", \"k\": \"4\", \"bootstrap\": \"9\""));
  ASSERT_EQ(summary.rows_size(), 2);
  EXPECT_EQ(summary.rows(0).settings(), "pca=100");
  EXPECT_EQ(summary.rows(0).runs(), 1);
  EXPECT_EQ(summary.rows(1).settings(), "pca=400");
  EXPECT_EQ(summary.rows(1).runs(), 2);
}

TEST_F(Summary, OverSequencesADataSetCountsOnceADrive) {
  const std::string runs = run("a", 0.5, "kitti", "\"pca\": \"400\", \"sequence\": \"00\"", "00") +
                           run("b", 0.7, "kitti", "\"pca\": \"400\", \"sequence\": \"05\"", "05") +
                           run("c", 0.9, "kitti", "\"pca\": \"400\", \"sequence\": \"06\"", "06");
  EXPECT_EQ(summarize(runs).rows_size(), 3);
  const auto summary = summarize("--over-sequences " + runs);
  ASSERT_EQ(summary.rows_size(), 1);
  EXPECT_EQ(summary.rows(0).sequence(), "00 05 06");
  EXPECT_EQ(summary.rows(0).runs(), 3);
  EXPECT_NEAR(summary.rows(0).average_precision().mean(), 0.7, 1e-12);
  EXPECT_NEAR(summary.rows(0).average_precision().deviation(), 0.2, 1e-12);
  const std::string again = run("d", 0.9, "kitti", "\"pca\": \"400\", \"sequence\": \"06\"", "06");
  EXPECT_EQ(summarize("--over-sequences " + runs + again).rows(0).runs(), 3);
}

TEST_F(Summary, LatestAndItsFolderAreOneRun) {
  const std::string a = run("a", 0.5, "1");
  fs::create_directory_symlink(dir_ / "a", dir_ / "latest");
  EXPECT_EQ(summarize(a + (dir_ / "latest").string()).rows(0).runs(), 1);
}

TEST_F(Summary, OfRunsOnTheSameDataTheLastCounts) {
  const auto summary = summarize(run("a", 0.5, "1") + run("b", 0.75, "1"));
  EXPECT_EQ(summary.rows(0).runs(), 1);
  EXPECT_EQ(summary.rows(0).average_precision().mean(), 0.75);
}

TEST_F(Summary, RejectsFoldersWithoutRuns) {
  EXPECT_EQ(run_revisit("report").exit_code, 2);
  EXPECT_EQ(report(run("a", 0.5, "1") + " --format xml").exit_code, 2);
  EXPECT_EQ(report((dir_ / "none").string()).exit_code, 3);
  fs::create_directory(dir_ / "empty");
  const auto no_run = report((dir_ / "empty").string());
  EXPECT_EQ(no_run.exit_code, 3);
  EXPECT_HAS(no_run.err, "run.json");
  const std::string a = run("a", 0.5, "1");
  write_file(dir_ / "a/run.json", "{\"tasks\": [");
  EXPECT_EQ(report(a).exit_code, 3);
}

TEST_F(Summary, MetricsOfOwnMatchesAreThoseComputedByHand) {
  // In the order of scores: correct, incorrect, correct. The last query has a match that was not
  // found.
  write_file(dir_ / "m.csv", "score,correct,positive\n0.9,1,1\n0.8,0,0\n0.7,TRUE,\n0.1,0,1\n");
  write_file(dir_ / "n.csv", "correct,score,note\n1,2,x\n0,1,y\n");
  const auto summary = summarize((dir_ / "m.csv").string() + " " + (dir_ / "n.csv").string());
  ASSERT_EQ(summary.rows_size(), 2);
  EXPECT_NEAR(summary.rows(0).average_precision().mean(), 1.0 / 3 + 1.0 / 3 * 2 / 3, 1e-12);
  EXPECT_NEAR(summary.rows(0).recall_at_1().mean(), 2.0 / 3, 1e-12);
  EXPECT_NEAR(summary.rows(0).max_recall_at_precision_1().mean(), 1.0 / 3, 1e-12);
  EXPECT_EQ(summary.rows(1).feature(), "n.csv");
  EXPECT_HAS(read_file(dir_ / "r.html"), "\"recall\":");
}

TEST_F(Summary, FaultsOfOwnMatchesHaveTheirLine) {
  for (const auto& [text, part] : std::initializer_list<std::pair<const char*, const char*>>{
           {"", "found nothing"},
           {"score\n1\n", "score and correct"},
           {"score,correct\n", "no matches"},
           {"score,correct\n1,1\nx,0\n", ":3: score"},
           {"score,correct\nnan,1\n", ":2: score"},
           {"score,correct\n1,maybe\n", ":2: correct"},
           {"score,correct\n1\n", ":2: correct"}}) {
    write_file(dir_ / "m.csv", text);
    const auto result = report((dir_ / "m.csv").string());
    EXPECT_EQ(result.exit_code, 3) << text;
    EXPECT_HAS(result.err, part);
  }
}

TEST_F(Summary, TakesOutputOfEval) {
  std::string folders;
  for (const char* name : {"one", "two"}) {
    write_small_drive(dir_ / name);
    run_ok("eval " + (dir_ / name).string() +
           " --feature data --geometry width=400 --protocol online,ssc --exclusion "
           "frames=8 --no-report --bootstrap 0 -o " +
           (dir_ / "results").string());
    folders += (dir_ / "results" / (std::string(name) + "_00/latest")).string() + " ";
  }
  const auto summary = summarize(folders);
  ASSERT_EQ(summary.rows_size(), 2);
  EXPECT_EQ(summary.rows(0).runs(), 2);
  EXPECT_EQ(summary.rows(0).average_precision().deviation(), 0);  // equal drives
  EXPECT_EQ(summary.rows(1).protocol(), "ssc");
  EXPECT_FALSE(summary.rows(1).has_recall_at_1());
  EXPECT_HAS(report(folders).out, "online");
}

}  // namespace
}  // namespace revisit
