// `revisit eval` and `revisit describe` as a person meets them, on a tiny drive.
#include <gtest/gtest.h>

#include <limits>

#include "small_drive.h"
#include "test_data.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;
using test::run_revisit;

class EvalCommand : public testing::Test {
 protected:
  EvalCommand() { test::write_small_drive(root()); }
  fs::path root() const { return dir_ / "drive"; }
  fs::path results() const { return dir_ / "results"; }
  std::string eval(const std::string& more = "") const {
    return "eval " + root().string() +
           " --feature data --width 400 --protocol online --exclusion frames=8 --radius 2 -o " +
           results().string() + " " + more;
  }
  fs::path run_folder() const { return fs::canonical(results() / "drive_00/latest"); }

  const test::TempDir dir_;
};

TEST_F(EvalCommand, WritesEveryFileOfARun) {
  const auto result = run_revisit(eval());
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("online"), std::string::npos);
  for (const char* file :
       {"config.yaml", "run.json", "metrics.json", "loops_online.csv", "pr_online.csv",
        "precision_recall.gp", "trajectory_online.gp", "match_online.gp"})
    EXPECT_TRUE(fs::exists(run_folder() / file)) << file;
  const std::string loops = test::read_file(run_folder() / "loops_online.csv");
  EXPECT_EQ(loops.substr(0, loops.find('\n')),
            "query_index,match_index,rank,query_time,match_time,cosine,score,margin,yaw_deg,"
            "accepted,true");
}

TEST_F(EvalCommand, FindsTheSecondPassOfASmallDrive) {
  const auto result = run_revisit(eval("--no-plots --format json"));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("\"n_positives\": 12"), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("\"recall_at_1\": 1"), std::string::npos) << result.out;
}

TEST_F(EvalCommand, ItsOwnConfigRepeatsARun) {
  ASSERT_EQ(run_revisit(eval("--no-plots")).exit_code, 0);
  const fs::path config = dir_ / "config.yaml";
  fs::copy_file(run_folder() / "config.yaml", config);
  const std::string first = test::read_file(run_folder() / "metrics.json");
  const auto again = run_revisit("eval " + root().string() + " --no-plots -c " + config.string() +
                                 " -o " + (dir_ / "again").string());
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_EQ(test::read_file(dir_ / "again/drive_00/latest/metrics.json"), first);
}

TEST_F(EvalCommand, UnknownConfigKeysAreNamed) {
  test::write_file(dir_ / "c.yaml", "radios: 3\n");
  const auto result = run_revisit(eval("-c " + (dir_ / "c.yaml").string()));
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_NE(result.err.find("did you mean 'radius'"), std::string::npos) << result.err;
}

TEST_F(EvalCommand, CommandLineBeatsEnvironmentBeatsConfig) {
  test::write_file(dir_ / "c.yaml", "k: 0\n");  // would fail
  const std::string config = " --no-plots -c " + (dir_ / "c.yaml").string();
  EXPECT_EQ(run_revisit(eval(config)).exit_code, 2);
  EXPECT_EQ(run_revisit(eval(config), "REVISIT_K=3").exit_code, 0);
  EXPECT_EQ(run_revisit(eval(config + " --k 0"), "REVISIT_K=3").exit_code, 2);
}

TEST_F(EvalCommand, FullDiskLeavesNothingThatLooksWhole) {
  // A file size limit stands for the full disk: the write fails the same way, with another errno.
  const auto result = run_revisit(eval(), "trap '' XFSZ; ulimit -f 256;");
  EXPECT_EQ(result.exit_code, 1) << result.err;
  EXPECT_NE(result.err.find("data-case1"), std::string::npos) << result.err;
  for (const auto& entry : fs::recursive_directory_iterator(results()))
    EXPECT_NE(entry.path().extension(), ".npy") << entry.path();
  EXPECT_EQ(run_revisit(eval("--no-plots")).exit_code, 0) << "the next run does not recover";
}

TEST_F(EvalCommand, CtrlCKeepsWhatWasDone) {
  test::write_small_drive(root(), 100);
  // Ctrl-C as soon as the first features are on the disk, however fast or busy the machine is.
  test::write_file(dir_ / "stop_midway.sh",
                   "\"$@\" &\n"
                   "until [ -n \"$(find '" +
                       results().string() +
                       "' -name 'data*.part' ! -name '*align*' -size +1k 2>/dev/null)\" ]; do\n"
                       "  kill -0 $! || exit 99\n"
                       "  sleep 0.005\n"
                       "done\n"
                       "kill -INT $!\n"
                       "wait $!\n");
  const auto stopped = run_revisit(eval("--no-plots --threads 1 --width 4000"),
                                   "sh " + (dir_ / "stop_midway.sh").string());
  EXPECT_EQ(stopped.exit_code, 130) << stopped.err;
  EXPECT_NE(stopped.err.find("goes on"), std::string::npos) << stopped.err;
  EXPECT_EQ(run_revisit(eval("--no-plots --width 4000")).exit_code, 0);
}

TEST_F(EvalCommand, BadInputHasItsExitCode) {
  const fs::path scan = root() / "sequences/00/velodyne/000003.bin";
  const std::string good = test::read_file(scan);
  const auto expect = [&](int code, const std::string& part, const std::string& more = "") {
    const auto result = run_revisit(eval("--no-plots " + more));
    EXPECT_EQ(result.exit_code, code) << result.err;
    EXPECT_NE(result.err.find(part), std::string::npos) << "no '" << part << "' in: " << result.err;
  };

  test::write_file(scan, good.substr(0, good.size() - 7));
  expect(3, "16 bytes");
  test::write_file(scan, "");
  expect(3, "000003.bin");
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::string all_nan;
  for (int i = 0; i < 400; ++i) all_nan.append(reinterpret_cast<const char*>(&nan), sizeof nan);
  test::write_file(scan, all_nan);
  expect(3, "000003.bin");
  test::write_file(scan, good);

  const std::string poses = test::read_file(root() / "poses/00.txt");
  test::write_file(root() / "poses/00.txt", poses.substr(0, poses.size() / 2));
  expect(3, "00.txt");
  fs::remove(root() / "poses/00.txt");
  expect(3, "poses");
  test::write_file(root() / "poses/00.txt", poses);

  expect(2, "did you mean", "--sensor hdl65");
  expect(2, "--protocol", "--protocol ''");
  expect(2, "--radius", "--radius -1");
  expect(2, "unexpected argument", "surplus");
  expect(3, "07", "--sequence 07");
}

TEST_F(EvalCommand, DescribeWritesDescriptorsAndAPcaModel) {
  const fs::path out = dir_ / "out";
  const std::string common = root().string() + " --feature data --width 400 --pca 5 -o ";
  const auto result = run_revisit("describe " + common + out.string());
  ASSERT_EQ(result.exit_code, 0) << result.err;
  for (const char* file : {"descriptors.npy", "frames.csv", "pca/mean.npy", "pca/basis.npy"})
    EXPECT_TRUE(fs::exists(out / file)) << file;
  const auto again = run_revisit("describe " + common + (dir_ / "two").string() + " --pca-fit " +
                                 (out / "pca").string());
  EXPECT_EQ(again.exit_code, 0) << again.err;
}

}  // namespace
}  // namespace revisit
