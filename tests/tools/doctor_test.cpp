#include "testing.h"

namespace {

using namespace revisit;

/// Output about `root`, with single spaces.
std::string data_text(const std::filesystem::path& root, int exit_code = 0) {
  const auto result = run_revisit("doctor '" + root.string() + "'");
  EXPECT_EQ(result.exit_code, exit_code) << result.out << result.err;
  std::string text;
  for (const char c : result.out)
    if (c != ' ' || !text.ends_with(' ')) text += c;
  return text;
}

void write_kitti(const TempDir& dir) {
  for (const char* frame : {"000000", "000001", "000007"})
    write_file(dir.path() / "sequences/00/velodyne" / (std::string(frame) + ".bin"),
               "1234567890123456");
  std::string poses, times;
  for (int i = 0; i < 8; ++i) poses += "1 0 0 0 0 1 0 0 0 0 1 0\n", times += "0.1\n";
  write_file(dir.path() / "sequences/00/times.txt", times);
  write_file(dir.path() / "poses/00.txt", poses);
}

TEST(DoctorData, CountsScansPosesAndTimes) {
  const TempDir dir;
  write_kitti(dir);
  EXPECT_EQ(data_text(dir.path()), " sequence 00 3 scans, 8 poses, times\n");
  for (const char* root : {"sequences/00", "sequences/00/"})
    EXPECT_EQ(data_text(dir.path() / root), " sequence 00 3 scans, 8 poses, times\n");
}

TEST(DoctorData, FoldersOfPlacesAndSetsOfThem) {
  const TempDir dir;
  for (const char* file : {"rotation/place_1/0.bin", "rotation/place_1/1.bin",
                           "rotation/place_2/a.pcd", "objects/hall/0.ply", "notes/readme.txt"})
    write_file(dir.path() / file, "1234567890123456");
  EXPECT_HAS(data_text(dir.path() / "rotation"), "2 places with 3 scans");
  EXPECT_EQ(data_text(dir.path()),
            " set objects 1 place with 1 scan\n set rotation 2 places with 3 scans\n");
}

TEST(DoctorData, EachMissingPieceIsNamed) {
  const TempDir dir;
  write_kitti(dir);
  write_file(dir.path() / "sequences/02/velodyne/000000.bin", "1234567890123456");
  std::filesystem::create_directories(dir.path() / "sequences/01");
  std::string text = data_text(dir.path());  // one sequence is enough
  for (const char* part :
       {"sequence 01 unusable", "has no scans", "1 scan, no poses, no times", "no ground truth"})
    EXPECT_HAS(text, part);

  write_file(dir.path() / "sequences/00/velodyne/000009.bin", "1234567890123456");
  text = data_text(dir.path());
  EXPECT_HAS(text, "holds 8 poses (frames 0 to 7)");
}

TEST(DoctorData, FolderOfScansAndNothing) {
  const TempDir dir;
  data_text(dir.path(), 5);
  write_file(dir / "._a.pcd", "x");  // what macOS leaves beside copied files
  data_text(dir.path(), 5);
  write_file(dir / "a.PCD", "x");
  data_text(dir.path());
  data_text(dir / "a.PCD", 3);  // no scan
  data_text(dir / "none", 5);
  write_file(dir / "b.pcd", "");
  EXPECT_HAS(data_text(dir.path()), "1 scan file empty; copy the data set again");
}

TEST(DoctorData, RealKittiExcerpt) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  const std::string text = data_text(kitti);
  EXPECT_HAS(text, "sequence 00 12 scans, 4541 poses");
}

TEST(Doctor, EverythingEssentialWorksHere) {
  const auto result = run_ok("doctor", "env -u OPENBLAS_CORETYPE");
  for (const char* word : {"self-test", "CPU", "SIMD", "OpenBLAS"}) EXPECT_HAS(result.out, word);
}

TEST(Doctor, WarnsOfVariablesThatSlowOpenBlasDown) {
  // Prescott's kernels have 128-bit vectors: too narrow for every CPU with AVX2.
  const auto result = run_ok("doctor", "OPENBLAS_CORETYPE=Prescott OPENBLAS_L2_SIZE=512");
  EXPECT_HAS(result.out, "unset it");
  const bool has_avx2 = result.out.find("use AVX") != std::string::npos;
  const bool warned = result.out.find("unset OPENBLAS_CORETYPE") != std::string::npos;
  EXPECT_EQ(warned, has_avx2) << result.out;
}

// OpenBLAS's threads wait for memory without end, and its exit handler for them.
TEST(Doctor, EndsWhereThereIsNoMemory) {
  for (const int kilobytes : {190'000, 220'000, 250'000}) {
    const auto result =
        run_revisit("doctor", "ulimit -v " + std::to_string(kilobytes) + "; timeout -s KILL 30");
    EXPECT_NE(result.exit_code, 128 + SIGKILL) << kilobytes;
  }
}

}  // namespace
