#include <gtest/gtest.h>

#include <filesystem>
#include <sstream>

#include "cli/json.h"
#include "expect_error.h"
#include "program_test.h"
#include "reports.pb.h"
#include "small_drive.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;
using Rows = std::vector<std::vector<std::string>>;

/// Skips the header.
template <class Keep>
Rows columns_of(const std::string& csv, const std::vector<size_t>& columns, const Keep& keep) {
  Rows rows;
  std::istringstream in(csv);
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    std::vector<std::string> cells(1), row;
    for (const char c : line)
      c == ',' ? static_cast<void>(cells.emplace_back()) : cells.back().push_back(c);
    if (!keep(cells)) continue;
    for (const size_t column : columns) row.push_back(cells.at(column));
    rows.push_back(row);
  }
  return rows;
}

/// A room driven through twice, and a street driven down and back up.
class Causal : public test::ProgramTest<Causal> {
 public:
  static void fill() {
    test::write_small_drive(path("room"));
    run("simulate -o " + path("street") +
        " --sensor vlp16 --route opposite --length 300 --every 12 -q");
  }

 protected:
  struct Run {
    reports::Metrics metrics;
    fs::path folder;
    Rows best() const {  // query, match, similarity, score, true, positive
      return columns_of(test::read_file(folder / ("loops_" + metrics.protocol() + ".csv")),
                        {0, 1, 5, 6, 10, 11}, [](const auto& cells) { return cells[2] == "1"; });
    }
  };
  static Run eval(const std::string& options) {
    reports::MetricsList list;
    parse_report(
        test::run_revisit("eval " + options + " -q --no-report --format json -o " + path("results"))
            .out,
        "eval", &list);
    return {list.tasks(0), list.folder()};
  }
  static std::string room(const std::string& more = "") {
    return path("room") + " --exclusion frames=8 --block frames=3 " + more;
  }
};

TEST_F(Causal, EqualsTheWholeDriveForAFeatureThatLearnsNothing) {
  const std::string how = " --feature scan-context --radius 2 --negative-radius 2";
  const Run causal = eval(room("--causal") + how), whole = eval(room() + how);
  EXPECT_EQ(causal.metrics.protocol(), "causal");
  EXPECT_EQ(causal.best(), whole.best());
  EXPECT_EQ(causal.metrics.n_positives(), 12);
  EXPECT_EQ(causal.metrics.average_precision(), whole.metrics.average_precision());
  EXPECT_EQ(causal.metrics.extended_precision(), whole.metrics.extended_precision());
  EXPECT_EQ(causal.metrics.bootstrap_blocks(), 5);
  EXPECT_EQ(causal.metrics.average_precision_ci(0), whole.metrics.average_precision_ci(0));
  EXPECT_FALSE(causal.metrics.has_loops()) << "nothing says from which score on";
}

TEST_F(Causal, IntervalsOfFewBlocksAreSaidToBeNarrow) {
  for (const char* causal : {"", "--causal"})
    for (const auto& [block, few] : {std::pair("3", true), {"1", false}}) {
      const std::string said =
          result_of("eval " + path("room") + " --exclusion frames=8 --feature scan-context " +
                        "--no-report -o " + path("results") + " --block frames=" + block + " " +
                        causal,
                    0)
              .err;
      EXPECT_EQ(
          said.find("blocks have a query with a true match, so the intervals") != std::string::npos,
          few)
          << said;
    }
}

TEST_F(Causal, LaterScansChangeNothing) {
  const std::string how =
      " --exclusion frames=3 --causal --feature data --geometry width=400 --pca 3 --warmup ";
  fs::copy(path("room"), path("shorter"), fs::copy_options::recursive);
  for (const int frame : {20, 21, 22, 23})
    fs::remove(path("shorter/sequences/00/velodyne/0000" + std::to_string(frame) + ".bin"));
  const Rows all = eval(path("room") + how + "6").best();
  const Rows before = eval(path("shorter") + how + "6").best();
  ASSERT_EQ(all.size(), before.size() + 4);
  EXPECT_TRUE(std::equal(before.begin(), before.end(), all.begin()));
  EXPECT_NE(all, eval(path("room") + how + "12").best()) << "it learns from others";
  EXPECT_HAS(run("eval " + path("room") + how + "60 -o " + path("none"), 2),
             "the PCA cannot be estimated (expected 60 distinct map entries");
}

TEST_F(Causal, FindsAndAcceptsWhatLoopsDoes) {
  const std::string how = " --exclusion frames=150 --sensor vlp16 -q ";
  const std::string of_loops = run("loops " + path("street") + how + "--all");
  const Rows asked = columns_of(of_loops, {0, 3}, [](const auto& cells) { return cells[7] != ""; });
  const Rows accepted =
      columns_of(of_loops, {0, 3}, [](const auto& cells) { return cells[10] == "1"; });
  const Run causal = eval(path("street") + how + "--causal --feature ring --radius 5");
  Rows found;
  for (const auto& row : causal.best()) found.push_back({row[0], row[1]});
  EXPECT_EQ(found, asked);
  const reports::AcceptedLoops& loops = causal.metrics.loops();
  EXPECT_EQ(loops.right() + loops.neither() + loops.wrong(), static_cast<int>(accepted.size()));
  EXPECT_GT(loops.right(), 3);
  EXPECT_EQ(loops.wrong(), 0);
  const Run by_score = eval(path("street") + how + "--causal --feature ring --no-verify");
  EXPECT_EQ(causal.metrics.score(), "verified");
  EXPECT_EQ(by_score.metrics.score(), "distinct-margin");
  const Run keyframes =
      eval(path("street") + how + "--causal --feature ring --keyframes meters=30");
  EXPECT_EQ(keyframes.metrics.n_queries(), causal.metrics.n_queries()) << "all are queries";
  EXPECT_LT(keyframes.metrics.n_positives(), causal.metrics.n_positives()) << "fewer are stored";
}

TEST_F(Causal, PairsAreTruthAsPosesAre) {
  const std::string how = " --feature scan-context ";
  test::write_file(path("pairs.csv"), run("gt " + path("room") +
                                          " --exclusion frames=8 --radius 2 --pairs --format csv"));
  const std::string listed = " --pairs " + path("pairs.csv");
  for (const std::string causal : {"", "--causal"}) {
    const Run by_poses = eval(room(causal) + how + "--radius 2 --negative-radius 2");
    const Run complete = eval(room(causal) + how + "--pairs-complete" + listed);
    EXPECT_EQ(complete.best(), by_poses.best());
    EXPECT_EQ(complete.metrics.average_precision(), by_poses.metrics.average_precision());
    EXPECT_EQ(complete.metrics.distance(), "pairs");
    const Run known = eval(room(causal) + how + listed);
    EXPECT_EQ(known.metrics.n_queries(), known.metrics.n_positives()) << "others are not asked";
    EXPECT_EQ(known.metrics.n_positives(), by_poses.metrics.n_positives());
    EXPECT_EQ(known.metrics.recall_at_1(), by_poses.metrics.recall_at_1());
  }
}

TEST_F(Causal, FoldersWithoutPosesAreOneRecording) {
  for (int i = 0; i < 24; ++i) {
    std::string name = std::to_string(i);
    name.insert(0, 6 - name.size(), '0');
    const fs::path lap = path(i < 12 ? "laps/first" : "laps/second");
    fs::create_directories(lap);
    fs::copy_file(path("room/sequences/00/velodyne/" + name + ".bin"), lap / (name + ".bin"));
  }
  // Queries 13 and 20 have a place, 21 has none, the others are unlabeled.
  test::write_file(path("laps.csv"),
                   "query,place\nsecond/000013,first/000002\nsecond/000020,first/000008\n"
                   "second/000021,\n");
  const std::string how =
      path("laps") + " --feature scan-context --exclusion frames=4 --pairs " + path("laps.csv");
  const Run near = eval(how + " --causal --pairs-near 1");
  EXPECT_EQ(near.metrics.n_queries(), 3);
  EXPECT_EQ(near.metrics.n_positives(), 2);
  EXPECT_EQ(near.metrics.recall_at_1(), 1) << "13 finds 1, 20 finds 8";
  EXPECT_EQ(eval(how).metrics.recall_at_1(), 0.5);
  EXPECT_HAS(run("eval " + how + " --exclusion frames=11 --no-report -o " + path("results")),
             "1 of 2 listed queries cannot find their place");
  const std::string table =
      run("robustness " + how + " --pairs-near 1 --no-report --perturb none -q --format csv -o " +
          path("results"));
  const Rows row = columns_of(table, {3, 5, 6, 10}, [](const auto&) { return true; });
  EXPECT_EQ(row, (Rows{{"3", "2", "2", "1.000000"}}));
}

TEST_F(Causal, MistakesAreSaid) {
  test::write_file(path("wrong.csv"), "20,3\n20,300\n");
  for (const auto& [options, message] : std::vector<std::pair<std::string, std::string>>{
           {"--keyframes meters=1", "--keyframes: needs --causal"},
           {"--causal --protocol ssc", "--causal: supports only the protocol online"},
           {"--causal --query-case both", "--query-case: not with --causal"},
           {"--causal --score similarity --feature ring --sensor vlp16",
            "--score: registered loops"},
           {"--causal --negative-radius 4", "--negative-radius: expected at least the radius, 5 m"},
           {"--negative-radius 4",
            "negative radius: task online: expected at least the radius, 5 m"},
           {"--block meters=1e-300", "block: meters=1e-300 is too short"},
           {"--pairs-near 2", "--pairs-near: needs --pairs"},
           {"--pairs x.csv --radius 3", "--pairs: not with --radius"},
           {"--radius 5 --negative-radius 3", "--negative-radius: expected at least the radius"},
           {"--block metre=3", "block: expected frames=N"}})
    EXPECT_HAS(run("eval " + room("--feature data ") + options + " -o " + path("none"), 2),
               message);
  EXPECT_HAS(run("eval " + room("--feature data --pairs " + path("wrong.csv")), 3),
             "wrong.csv:2: expected a scan of room, frame 0 (000000) to 23 (000023), found '300'");
}

}  // namespace
}  // namespace revisit::cli
