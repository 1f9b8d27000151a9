#include <gtest/gtest.h>

#include <csignal>

#include "doctor/checks.h"
#include "test_data.h"

namespace {

using namespace revisit;
using doctor::Status;

doctor::Checks data_checks(const std::filesystem::path& root) {
  doctor::Checks checks;
  doctor::check_data(root, checks);
  return checks;
}

const doctor::Check* find(const doctor::Checks& checks, const std::string& name) {
  for (const doctor::Check& check : checks)
    if (check.name == name) return &check;
  return nullptr;
}

void write_kitti(const test::TempDir& dir) {
  for (const char* frame : {"000000", "000001", "000007"})
    test::write_file(dir.path() / "sequences/00/velodyne" / (std::string(frame) + ".bin"),
                     "1234567890123456");
  std::string poses, times;
  for (int i = 0; i < 8; ++i) poses += "1 0 0 0 0 1 0 0 0 0 1 0\n", times += "0.1\n";
  test::write_file(dir.path() / "sequences/00/times.txt", times);
  test::write_file(dir.path() / "poses/00.txt", poses);
}

TEST(DoctorData, WholeSequenceIsOk) {
  const test::TempDir dir;
  write_kitti(dir);
  const auto checks = data_checks(dir.path());
  ASSERT_EQ(checks.size(), 2U);
  EXPECT_EQ(checks[0].status, Status::kOk);
  EXPECT_EQ(checks[1].name, "sequence 00");
  EXPECT_EQ(checks[1].status, Status::kOk) << checks[1].advice;
  EXPECT_EQ(checks[1].found, "3 scans, 8 poses, times");
}

TEST(DoctorData, CameraImagesAreCounted) {
  const test::TempDir dir;
  write_kitti(dir);
  for (const char* frame : {"000000", "000001"})
    test::write_file(dir.path() / "sequences/00/image_0" / (std::string(frame) + ".png"), "");
  EXPECT_NE(data_checks(dir.path())[1].advice.find("000007"), std::string::npos)
      << "a scan without an image: " << data_checks(dir.path())[1].advice;
  test::write_file(dir.path() / "sequences/00/image_0/000007.png", "");
  EXPECT_EQ(data_checks(dir.path())[1].found, "3 scans, 8 poses, times, 3 images");
}

TEST(DoctorData, FoldersOfPlacesAndSetsOfThem) {
  const test::TempDir dir;
  for (const char* file : {"rotation/place_1/0.bin", "rotation/place_1/1.bin",
                           "rotation/place_2/a.pcd", "objects/hall/0.ply", "notes/readme.txt"})
    test::write_file(dir.path() / file, "1234567890123456");
  const auto one = data_checks(dir.path() / "rotation");
  ASSERT_EQ(one.size(), 2U);
  EXPECT_EQ(one[0].status, Status::kOk);
  EXPECT_EQ(one[1].found, "2 places with 3 scans");
  const auto sets = data_checks(dir.path());
  ASSERT_EQ(sets.size(), 3U);
  EXPECT_EQ(sets[0].status, Status::kOk);
  EXPECT_EQ(sets[1].name, "set objects");
  EXPECT_EQ(sets[1].found, "1 place with 1 scan");
  EXPECT_EQ(sets[2].found, "2 places with 3 scans");
}

TEST(DoctorData, OneSequenceFolderFindsItsPoses) {
  const test::TempDir dir;
  write_kitti(dir);
  for (const char* root : {"sequences/00", "sequences/00/"}) {
    const auto checks = data_checks(dir.path() / root);
    ASSERT_EQ(checks.size(), 2U);
    EXPECT_EQ(checks[1].name, "sequence 00");
    EXPECT_EQ(checks[1].found, "3 scans, 8 poses, times");
  }
}

TEST(DoctorData, EachMissingPieceIsNamed) {
  const test::TempDir dir;
  write_kitti(dir);
  test::write_file(dir.path() / "sequences/00/velodyne/000003.bin", "");
  test::write_file(dir.path() / "sequences/02/velodyne/000000.bin", "1234567890123456");
  std::filesystem::create_directories(dir.path() / "sequences/01");
  auto checks = data_checks(dir.path());
  ASSERT_EQ(checks.size(), 4U);
  EXPECT_EQ(checks[0].status, Status::kOk);  // one sequence is enough
  EXPECT_EQ(checks[1].status, Status::kWarn);
  EXPECT_NE(checks[1].advice.find("1 scan file empty"), std::string::npos) << checks[1].advice;
  EXPECT_EQ(checks[2].name, "sequence 01");
  EXPECT_EQ(checks[2].status, Status::kWarn);
  EXPECT_NE(checks[2].advice.find("has no scans"), std::string::npos) << checks[2].advice;
  EXPECT_EQ(checks[3].found, "1 scan, no poses, no times");
  EXPECT_NE(checks[3].advice.find("no ground truth"), std::string::npos) << checks[3].advice;

  test::write_file(dir.path() / "sequences/00/velodyne/000009.bin", "1234567890123456");
  checks = data_checks(dir.path());
  EXPECT_EQ(checks[1].status, Status::kWarn);
  EXPECT_NE(checks[1].advice.find("holds 8 poses (frames 0 to 7)"), std::string::npos)
      << checks[1].advice;
}

TEST(DoctorData, FolderOfScansAndNothing) {
  const test::TempDir dir;
  EXPECT_EQ(data_checks(dir.path())[0].status, Status::kMissing);
  EXPECT_TRUE(data_checks(dir.path())[0].essential);
  test::write_file(dir / "._a.pcd", "x");  // what macOS leaves beside copied files
  EXPECT_EQ(data_checks(dir.path())[0].status, Status::kMissing);
  test::write_file(dir / "a.PCD", "x");
  EXPECT_EQ(data_checks(dir.path())[0].status, Status::kOk);
  EXPECT_EQ(data_checks(dir / "a.PCD")[0].status, Status::kMissing);
  EXPECT_EQ(data_checks(dir / "none")[0].status, Status::kMissing);
}

TEST(DoctorData, RealKittiExcerpt) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  const auto checks = data_checks(kitti);
  const doctor::Check* sequence = find(checks, "sequence 00");
  ASSERT_NE(sequence, nullptr);
  EXPECT_EQ(sequence->status, Status::kOk) << sequence->advice;
  EXPECT_TRUE(sequence->found.starts_with("12 scans, 4541 poses")) << sequence->found;
}

TEST(Doctor, EverythingEssentialWorksHere) {
  const test::TempDir cache;
  const std::string environment =
      "env -u OPENBLAS_CORETYPE REVISIT_MODELS='" + cache.path().string() + "'";
  const auto result = test::run_revisit("doctor", environment);
  EXPECT_EQ(result.exit_code, 0) << result.out << result.err;
  for (const char* word : {"self-test", "SIMD", "OpenBLAS", "terminal", "make-random"})
    EXPECT_NE(result.out.find(word), std::string::npos) << word << "\n" << result.out;
}

TEST(Doctor, WarnsOfVariablesThatSlowOpenBlasDown) {
  // Prescott's kernels have 128-bit vectors: too narrow for every CPU with AVX2.
  const auto result =
      test::run_revisit("doctor", "OPENBLAS_CORETYPE=Prescott OPENBLAS_L2_SIZE=512");
  EXPECT_EQ(result.exit_code, 0) << result.out << result.err;
  EXPECT_NE(result.out.find("unset it"), std::string::npos) << result.out;
  const bool has_avx2 = result.out.find("AVX2") != std::string::npos;
  const bool warned = result.out.find("unset OPENBLAS_CORETYPE") != std::string::npos;
  EXPECT_EQ(warned, has_avx2) << result.out;
}

TEST(Doctor, MissingDataIsExitCode5) {
  const auto result = test::run_revisit("doctor /nowhere --format json");
  EXPECT_EQ(result.exit_code, 5) << result.out << result.err;
  EXPECT_NE(result.out.find("\"ok\": false"), std::string::npos) << result.out;
  EXPECT_EQ(test::run_revisit("doctor --format csv").exit_code, 2);
}

// OpenBLAS's threads wait for memory without end, and its exit handler for them.
TEST(Doctor, EndsWhereThereIsNoMemory) {
  for (const int kilobytes : {190'000, 220'000, 250'000}) {
    const auto result = test::run_revisit(
        "doctor", "ulimit -v " + std::to_string(kilobytes) + "; timeout -s KILL 30");
    EXPECT_NE(result.exit_code, 128 + SIGKILL) << kilobytes;
  }
}

}  // namespace
