#include "revisit/datasets/dataset.h"
#include "testing.h"

namespace revisit {
namespace {

const std::string kIdentityLine = "1 0 0 0 0 1 0 0 0 0 1 0\n";
const std::string kQuarterTurn = "0 -1 0 1.5 +1.0e+00 0 0 -2 0 0 1 1e2\n";  // about z

template <class Read>
std::string complaint_about(Read read, const std::string& content) {
  const TempDir dir;
  write_file(dir / "file.txt", content);
  try {
    read(dir / "file.txt");
  } catch (const InputError& error) {
    EXPECT_TRUE(std::string(error.what()).starts_with((dir / "file.txt").string())) << error.what();
    return std::string(error.what()).substr((dir / "file.txt").string().size());
  }
  return "";
}

TEST(Poses, RowMajor3x4LineByLine) {
  const TempDir dir;
  for (const char* const ending : {"", "\n", " \n\r\n"}) {
    write_file(dir / "poses.txt", kIdentityLine + kQuarterTurn + ending);
    const std::vector<Pose> poses = read_kitti_poses(dir / "poses.txt");
    ASSERT_EQ(poses.size(), 2U);
    EXPECT_TRUE(poses[0].isApprox(Pose::Identity()));
    EXPECT_EQ((poses[1] * Eigen::Vector3d(1, 0, 0)), Eigen::Vector3d(1.5, -1, 100));
    EXPECT_EQ((poses[1] * Eigen::Vector3d(0, 1, 0)), Eigen::Vector3d(0.5, -2, 100));
  }
}

TEST(TimedPoses, TimesInMessagesHaveAllDigits) {
  ScanRef scan;
  scan.time = 1.7e9;
  const std::string text = complaint_about(
      [&](const fs::path& file) {
        poses_of(read_timed_poses(file), {&scan, 1}, 0.1);
      },
      "1700000400.5 0 0 0 0 0 0 1\n");
  EXPECT_HAS(text, "from 1700000000 to 1700000000 s, the poses from 1700000400.5 to");
}

TEST(TextFiles, AByteOrderMarkIsNotPartOfTheFirstLine) {
  const TempDir dir;
  const std::string mark = "\xEF\xBB\xBF";
  write_file(dir / "poses.txt", mark + kIdentityLine);
  write_file(dir / "times.txt", mark + "1.5\n2\n");
  write_file(dir / "calib.txt", mark + "Tr: " + kIdentityLine);
  EXPECT_EQ(read_kitti_poses(dir / "poses.txt").size(), 1U);
  EXPECT_EQ(read_kitti_times(dir / "times.txt"), (std::vector<double>{1.5, 2}));
  EXPECT_TRUE(read_kitti_calibration(dir / "calib.txt").isApprox(Pose::Identity()));
}

TEST(Poses, WindowsLineEnds) {
  const TempDir dir;
  write_file(dir / "poses.txt", "1 0 0 7 0 1 0 0 0 0 1 0\r\n1 0 0 8 0 1 0 0 0 0 1 0\r\n");
  const std::vector<Pose> poses = read_kitti_poses(dir / "poses.txt");
  ASSERT_EQ(poses.size(), 2U);
  EXPECT_EQ(poses[1].translation().x(), 8);
}

TEST(Poses, RefusesWithFileAndLine) {
  EXPECT_HAS(complaint_about(read_kitti_poses, kIdentityLine + "1 0 0 0 0 1 0 0 0 0 1\n"),
             ":2: expected the 12");
  EXPECT_HAS(complaint_about(read_kitti_poses, kIdentityLine + "1 0 0 0 0 1 0 0 0 0 1 0 1\n"),
             "found 13");
  EXPECT_HAS(complaint_about(read_kitti_poses, "1 0 0 x 0 1 0 0 0 0 1 0\n"),
             ":1: expected a finite number, found 'x'");
  EXPECT_HAS(complaint_about(read_kitti_poses, "1 0 0 nan 0 1 0 0 0 0 1 0\n"), "found 'nan'");
  EXPECT_HAS(complaint_about(read_kitti_poses, "1 0 0 1e999 0 1 0 0 0 0 1 0\n"), "found '1e999'");
  EXPECT_HAS(complaint_about(read_kitti_poses, kIdentityLine + "\n" + kIdentityLine),
             ":3: expected the pose of frame 1 on the line before");
  EXPECT_HAS(complaint_about(read_kitti_poses, "2 0 0 0 0 1 0 0 0 0 1 0\n"),
             ":1: the first three columns are not a rotation");
  EXPECT_HAS(complaint_about(read_kitti_poses, "1 0 0 0 0 1 0 0 0 0 -1 0\n"), "determinant -1");
  EXPECT_HAS(complaint_about(read_kitti_poses, "\n\n"), "is empty");
  EXPECT_EQ(complaint_about(read_kitti_poses, "1.004 0 0 0 0 1 0 0 0 0 1 0\n"), "");  // within 1e-2
  EXPECT_THROW(read_kitti_poses("/nowhere/poses.txt"), InputError);
}

TEST(Calibration, ProjectionsByName) {
  const TempDir dir;
  write_file(dir / "calib.txt",
             "P0: 7 0 6 0 0 8 2 0 0 0 1 0\r\nP1: 7 0 6 -3 0 7 2 0 0 0 1 0\n" + kIdentityLine);
  Eigen::Matrix<double, 3, 4> P1;
  P1 << 7, 0, 6, -3, 0, 7, 2, 0, 0, 0, 1, 0;
  EXPECT_EQ(read_kitti_projection(dir / "calib.txt", "P1"), P1);
  EXPECT_EQ(read_kitti_projection(dir / "calib.txt", "P0")(1, 1), 8);
  const auto read_P0 = [](const std::filesystem::path& file) {
    return read_kitti_projection(file, "P0");
  };
  EXPECT_HAS(complaint_about(read_P0, "Tr: 1\n"),
             "no line 'P0:' (projection of a camera); found Tr");
  EXPECT_HAS(complaint_about(read_P0, "P0: 7 0 6 0 0 8 2 0 0 0 1\n"), ":1: expected the 12");
  for (const char* const bad : {"-7 0 6 0 0 8 2 0 0 0 1 0", "7 0 6 0 0 0 2 0 0 0 1 0",
                                "7 0 6 0 0 8 2 0 0 1 0 0", "7 0 6 0 0 8 2 0 0 0 2 0"})
    EXPECT_HAS(complaint_about(read_P0, str("P0: ", bad, "\n")), ":1: expected a projection");
}

TEST(Calibration, TrUnderBothNames) {
  const TempDir dir;
  for (const char* const key : {"Tr", "Tr_velo_to_cam"}) {
    write_file(dir / "calib.txt", "P0: 1 2 3\n\n" + std::string(key) + ": " + kQuarterTurn);
    EXPECT_EQ(read_kitti_calibration(dir / "calib.txt").translation(),
              Eigen::Vector3d(1.5, -2, 100));
  }
  EXPECT_HAS(complaint_about(read_kitti_calibration, "P0: 1\nP1: 2\n"),
             "no line 'Tr:' (velodyne to camera); found P0, P1");
  EXPECT_HAS(complaint_about(read_kitti_calibration, ""), "no line 'Tr:'");
  EXPECT_HAS(complaint_about(read_kitti_calibration, "P0: 1\nTr: 1 2 3\n"), ":2: expected the 12");
}

TEST(Times, OneSecondALine) {
  const TempDir dir;
  write_file(dir / "times.txt", "0.000000e+00\r\n1.037359e-01\r\n");
  EXPECT_EQ(read_kitti_times(dir / "times.txt"), (std::vector<double>{0, 0.1037359}));
  EXPECT_HAS(complaint_about(read_kitti_times, "0\n1 2\n"), ":2: expected one time");
  EXPECT_HAS(complaint_about(read_kitti_times, "0\n\n2\n"), ":3: expected the time of frame 1");
  EXPECT_HAS(complaint_about(read_kitti_times, "inf\n"), "finite");
  EXPECT_HAS(complaint_about(read_kitti_times, ""), "is empty");
}

TEST(RealPoses, EverySequenceReads) {
  REVISIT_NEED_SHARED(folder, "data/kitti");
  EXPECT_EQ(read_kitti_poses(folder / "poses" / "00.txt").size(), 4541U);
  EXPECT_EQ(read_kitti_poses(folder / "poses" / "08.txt").size(), 4071U);
  EXPECT_EQ(read_kitti_times(folder / "sequences/00/times.txt").size(), 4541U);
  const Pose T_cam_velo = read_kitti_calibration(folder / "sequences/00/calib.txt");
  // Forward of the velodyne is forward (z) of the camera.
  EXPECT_GT((T_cam_velo.linear() * Eigen::Vector3d(1, 0, 0)).z(), 0.999);
}

}  // namespace
}  // namespace revisit
