#include <gtest/gtest.h>

#include <sstream>

#include "test_data.h"

namespace revisit {
namespace {

/// A drive of `n` poses along z, 10 m apart; the last one is 1 m from the first.
std::string poses(int n) {
  std::ostringstream text;
  for (int i = 0; i < n; ++i) text << "1 0 0 0 0 1 0 0 0 0 1 " << (i + 1 < n ? 10 * i : 1) << "\n";
  return text.str();
}

TEST(Gt, KnownCountsOfTheOfficialPoses) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  const std::pair<const char*, int> known[] = {{"00", 804}, {"05", 503}, {"06", 270}, {"08", 345}};
  for (const auto& [sequence, count] : known) {
    const auto result =
        test::run_revisit("gt '" + kitti.string() + "' --sequence " + sequence +
                          " --distance xz --radius 5 --exclusion frames=50 --format json");
    EXPECT_EQ(result.exit_code, 0) << result.err;
    EXPECT_NE(result.out.find("\"n_positives\": " + std::to_string(count) + ","), std::string::npos)
        << result.out;
    EXPECT_NE(result.out.find(std::string("\"sequence\": \"") + sequence + "\""),
              std::string::npos);
    EXPECT_EQ(result.err, "");
  }
}

TEST(Gt, FormatsAndPairs) {
  const test::TempDir dir;
  test::write_file(dir / "poses/07.txt", poses(60));
  const std::string run = "gt '" + dir.path().string() + "' --sequence 07 ";
  EXPECT_EQ(test::run_revisit(run + "--format csv").out,
            "sequence,distance,radius_m,exclusion,n_frames,n_queries,n_positives,n_pairs\n"
            "07,xz,5,frames=50,60,9,1,1\n");
  EXPECT_EQ(test::run_revisit(run + "--format csv --pairs").out,
            "query,match,distance_m\n59,0,1.000\n");
  EXPECT_NE(test::run_revisit(run + "--pairs").out.find("59      0       1.000"),
            std::string::npos);
  EXPECT_NE(test::run_revisit(run + "--format json --pairs").out.find("\"match\": 0"),
            std::string::npos);
  EXPECT_EQ(test::run_revisit(run + "--format json").out.find("\"match\""), std::string::npos);
}

TEST(Gt, PairsAreOfScansThatThereAre) {
  const test::TempDir dir;
  test::write_file(dir / "poses/07.txt", poses(60));
  const std::string scan(16, '\1');
  for (const char* name : {"000000", "000058", "000059"})
    test::write_file(dir / "sequences/07/velodyne" / (std::string(name) + ".bin"), scan);
  const std::string run = "gt '" + dir.path().string() + "' --sequence 07 --format csv --pairs";
  EXPECT_EQ(test::run_revisit(run).out, "query,match,distance_m\n59,0,1.000\n");
  std::filesystem::remove(dir / "sequences/07/velodyne/000000.bin");
  const auto without = test::run_revisit(run);
  EXPECT_EQ(without.out, "query,match,distance_m\n");
  EXPECT_NE(without.err.find("1 pairs of frames without a scan are skipped"), std::string::npos);
  const std::string report = test::run_revisit(run + " --format json").out;
  EXPECT_NE(report.find("\"n_positives\": 0"), std::string::npos) << report;
}

TEST(Gt, SecondsNeedTimeStamps) {
  const test::TempDir dir;
  test::write_file(dir / "poses/07.txt", poses(5));
  const std::string run =
      "gt '" + dir.path().string() + "' --sequence 07 --exclusion seconds=30 --format csv";
  const auto missing = test::run_revisit(run);
  EXPECT_EQ(missing.exit_code, 3);
  EXPECT_NE(missing.err.find("times.txt"), std::string::npos) << missing.err;
  test::write_file(dir / "sequences/07/times.txt", "0\n1\n2\n3\n31\n");
  EXPECT_NE(test::run_revisit(run).out.find("07,xz,5,seconds=30,5,1,1,1"), std::string::npos);
  test::write_file(dir / "sequences/07/times.txt", "0\n1\n2\n3\n");
  EXPECT_EQ(test::run_revisit(run).exit_code, 3);
}

TEST(Gt, WrongUseIsSaid) {
  const test::TempDir dir;
  test::write_file(dir / "poses/07.txt", poses(5));
  const std::string data = "gt '" + dir.path().string() + "' --sequence 07 ";
  for (const char* bad : {"--distance xy", "--exclusion frames", "--radius 0", "--radius nan",
                          "--radius x", "--format xml", "extra"})
    EXPECT_EQ(test::run_revisit(data + bad).exit_code, 2) << bad;
  EXPECT_EQ(test::run_revisit("gt '" + dir.path().string() + "' --sequence 08").exit_code, 3);
  EXPECT_EQ(test::run_revisit("gt /does/not/exist --sequence 00").exit_code, 3);
  EXPECT_EQ(test::run_revisit("gt").exit_code, 2);
  test::write_file(dir / "poses/07.txt", "1 0 0 0 0 1 0 0 0 0 1 nan\n");
  EXPECT_EQ(test::run_revisit(data).exit_code, 3);
}

}  // namespace
}  // namespace revisit
