#include "cli/json.h"
#include "program_test.h"
#include "reports.pb.h"
#include "small_drive.h"
#include "testing.h"

namespace revisit::cli {
namespace {

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
class DrivingOrder : public test::ProgramTest<DrivingOrder> {
 public:
  static void fill() {
    write_small_drive(path("room"));
    run("simulate -o " + path("street") +
        " --sensor vlp16 --route opposite --length 300 --every 12 -q");
  }

 protected:
  struct Run {
    reports::Metrics metrics;
    fs::path folder;
    Rows best() const {  // query, match, similarity, score, correct, positive
      return columns_of(read_file(folder / ("loops_" + metrics.protocol() + ".csv")),
                        {0, 1, 5, 6, 10, 11}, [](const auto& cells) { return cells[2] == "1"; });
    }
  };
  static constexpr const char* kOnline = " --protocol online ";
  static Run eval(const std::string& options) {
    reports::Run run;
    parse_report(
        test::run_revisit("eval " + options + " -q --no-report --format json -o " + path("results"))
            .out,
        "eval", &run);
    return {run.tasks(0).metrics(), run.folder()};
  }
  static std::string room(const std::string& more = "") {
    return path("room") + " --exclusion frames=8 --bootstrap 1000,frames=3 " + more;
  }
};

TEST_F(DrivingOrder, EqualsTheWholeDriveForAFeatureThatLearnsNothing) {
  const std::string how = " --feature scan-context --radius 2 --negative-radius 2";
  const Run driving = eval(room() + how), whole = eval(room(kOnline) + how);
  EXPECT_EQ(driving.metrics.protocol(), "driving-order");
  EXPECT_EQ(driving.best(), whole.best());
  EXPECT_EQ(driving.metrics.n_positives(), 12);
  EXPECT_EQ(driving.metrics.average_precision(), whole.metrics.average_precision());
  EXPECT_EQ(driving.metrics.extended_precision(), whole.metrics.extended_precision());
  EXPECT_EQ(driving.metrics.bootstrap_blocks(), 5);
  EXPECT_EQ(driving.metrics.average_precision_ci(0), whole.metrics.average_precision_ci(0));
  EXPECT_FALSE(driving.metrics.has_loops()) << "nothing says from which score on";
}

TEST_F(DrivingOrder, IntervalsOfFewBlocksAreSaidToBeNarrow) {
  for (const char* protocol : {"", kOnline})
    for (const auto& [block, few] : {std::pair("3", true), {"1", false}}) {
      const std::string said =
          result_of("eval " + path("room") + " --exclusion frames=8 --feature scan-context " +
                        "--no-report -o " + path("results") + " --bootstrap 1000,frames=" + block +
                        " " + protocol,
                    0)
              .err;
      EXPECT_EQ(said.find("blocks have a query with a correct match, so the intervals") !=
                    std::string::npos,
                few)
          << said;
    }
}

TEST_F(DrivingOrder, LaterScansChangeNothing) {
  const std::string how =
      " --exclusion frames=3 --feature data --geometry width=400 --pca 3 --warmup ";
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

TEST_F(DrivingOrder, FindsAndAcceptsTheLoopsOfTheLoopsCommand) {
  const std::string how = " --exclusion frames=150 --sensor vlp16 -q ";
  Run driving;
  Rows accepted;
  for (const char* scans : {"--local-map 10 ", ""}) {
    const std::string of_loops =
        run("loops " + path("street") + how + scans + "--all --odometry-gate none");
    const Rows asked =
        columns_of(of_loops, {0, 3}, [](const auto& cells) { return cells[7] != ""; });
    accepted = columns_of(of_loops, {0, 3}, [](const auto& cells) { return cells[10] == "1"; });
    driving = eval(path("street") + how + scans + "--feature ring --radius 5");
    Rows found;
    for (const auto& row : driving.best()) found.push_back({row[0], row[1]});
    EXPECT_EQ(found, asked);
  }
  const reports::AcceptedLoops& loops = driving.metrics.loops();
  EXPECT_EQ(loops.correct() + loops.ignored() + loops.incorrect(),
            static_cast<int>(accepted.size()));
  EXPECT_GT(loops.correct(), 3);
  EXPECT_EQ(loops.incorrect(), 0);
  const Run by_score = eval(path("street") + how + "--feature ring --score distinct-margin");
  EXPECT_EQ(driving.metrics.score(), "verified");
  EXPECT_EQ(by_score.metrics.score(), "distinct-margin");
  const Run keyframes = eval(path("street") + how + "--feature ring --keyframes meters=30");
  EXPECT_EQ(keyframes.metrics.n_queries(), driving.metrics.n_queries()) << "all are queries";
  EXPECT_LT(keyframes.metrics.n_positives(), driving.metrics.n_positives()) << "fewer are stored";
}

TEST_F(DrivingOrder, PairsAreTruthAsPosesAre) {
  const std::string how = " --feature scan-context ";
  EXPECT_HAS(run("eval " + room("--radius 2 --ground-truth " + path("pairs.csv"))),
             "12 of 15 queries have a correct match: ");
  const std::string listed = " --pairs " + path("pairs.csv");
  for (const std::string protocol : {"", kOnline}) {
    const Run by_poses = eval(room(protocol) + how + "--radius 2 --negative-radius 2");
    const Run complete = eval(room(protocol) + how + listed + ",complete");
    EXPECT_EQ(complete.best(), by_poses.best());
    EXPECT_EQ(complete.metrics.average_precision(), by_poses.metrics.average_precision());
    EXPECT_EQ(complete.metrics.distance(), "pairs");
    const Run known = eval(room(protocol) + how + listed);
    EXPECT_EQ(known.metrics.n_queries(), known.metrics.n_positives()) << "others are not asked";
    EXPECT_EQ(known.metrics.n_positives(), by_poses.metrics.n_positives());
    EXPECT_EQ(known.metrics.recall_at_1(), by_poses.metrics.recall_at_1());
  }
}

TEST_F(DrivingOrder, FoldersWithoutPosesAreOneRecording) {
  for (int i = 0; i < 24; ++i) {
    std::string name = std::to_string(i);
    name.insert(0, 6 - name.size(), '0');
    const fs::path lap = path(i < 12 ? "laps/first" : "laps/second");
    fs::create_directories(lap);
    fs::copy_file(path("room/sequences/00/velodyne/" + name + ".bin"), lap / (name + ".bin"));
  }
  // Queries 13 and 20 have a place, 21 has none, the others are unlabeled.
  write_file(path("laps.csv"),
             "query,place\nsecond/000013,first/000002\nsecond/000020,first/000008\n"
             "second/000021,\n");
  const std::string how =
      path("laps") + " --feature scan-context --exclusion frames=4 --pairs " + path("laps.csv");
  const Run near = eval(how + ",near=1");
  EXPECT_EQ(near.metrics.n_queries(), 3);
  EXPECT_EQ(near.metrics.n_positives(), 2);
  EXPECT_EQ(near.metrics.recall_at_1(), 1) << "13 finds 1, 20 finds 8";
  EXPECT_EQ(eval(how + kOnline).metrics.recall_at_1(), 0.5);
  EXPECT_HAS(
      run("eval " + how + kOnline + " --exclusion frames=11 --no-report -o " + path("results")),
      "1 of 2 listed queries cannot find their place");
  const Run perturbed = eval(how + ",near=1 --perturb none");
  EXPECT_EQ(perturbed.metrics.n_queries(), 3);
  EXPECT_EQ(perturbed.metrics.n_positives(), 2);
  EXPECT_EQ(perturbed.metrics.neighbor(), 2);
  EXPECT_EQ(perturbed.metrics.recall_at_1(), 1);
}

TEST_F(DrivingOrder, MistakesAreSaid) {
  write_file(path("wrong.csv"), "20,3\n20,300\n");
  for (const auto& [options, message] : std::vector<std::pair<std::string, std::string>>{
           {"--protocol online --keyframes meters=1",
            "--keyframes: belongs to the protocol driving-order"},
           {"--protocol driving-order,ssc", "driving-order is evaluated alone"},
           {"--query-case both", "--query-case: not in driving order"},
           {"--negative-radius 4", "--negative-radius: expected at least the radius, 5 m"},
           {"--protocol online --negative-radius 4",
            "negative radius: task online: expected at least the radius, 5 m"},
           {"--protocol online --bootstrap 9,meters=1e-300", "block: meters=1e-300 is too short"},
           {"--pairs near=2", "--pairs: expected a file"},
           {"--pairs x.csv --radius 3", "--pairs: not with --radius"},
           {"--radius 5 --negative-radius 3", "--negative-radius: expected at least the radius"},
           {"--bootstrap 9,metre=3", "block: expected frames=N"}})
    EXPECT_HAS(run("eval " + room("--feature data ") + options + " -o " + path("none"), 2),
               message);
  EXPECT_HAS(run("eval " + room("--feature data --pairs " + path("wrong.csv")), 3),
             "wrong.csv:2: expected a scan of room, frame 0 (000000) to 23 (000023), found '300'");
}

}  // namespace
}  // namespace revisit::cli
