#include "revisit/datasets/scan_file.h"
#include "testing.h"

namespace revisit {
namespace {

/// A ring of points 10 m away, stretched along x, and one point without a return.
std::string small_scan() {
  std::string bytes(16, '\0');
  for (int i = 0; i < 1000; ++i) {
    const double angle = i * 0.0062831853;
    const float point[4] = {static_cast<float>(20 * std::cos(angle)),
                            static_cast<float>(10 * std::sin(angle)),
                            static_cast<float>(-0.001 * i), 0};
    bytes.append(reinterpret_cast<const char*>(point), sizeof point);
  }
  return bytes;
}

std::string quoted(const fs::path& path) {
  return "'" + path.string() + "'";
}

/// A folder with a scan.
struct DoctorScan : testing::Test {
  DoctorScan() { write_file(dir / "a.bin", small_scan()); }
  const TempDir dir;
  const std::string command = "doctor " + quoted(dir / "a.bin");
};

TEST_F(DoctorScan, PrintsTheScanAndWritesBothImages) {
  const fs::path out = dir / "new/folder";
  const auto result = run_ok(command + " --images " + quoted(out));
  EXPECT_EQ(result.err, "");
  for (const char* const name : {"a_projected.png", "a_closed.png"}) {
    EXPECT_HAS(result.out, (out / name).string());
    EXPECT_EQ(read_file(out / name).substr(1, 3), "PNG") << name;
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(out), fs::directory_iterator()), 2);
  EXPECT_HAS(result.out, "usable points     1000\n");
  EXPECT_HAS(result.out, "4000 x 112, auto");
  EXPECT_HAS(result.out, "eigenvalue ratio");

  const auto other =
      run_ok(command + " --sensor vlp16 --geometry width=1000,closing-width=0 --align none");
  EXPECT_HAS(other.out, "1000 x 112, vlp16");
  EXPECT_EQ(other.out.find("yaw"), std::string::npos) << "not computed, so not printed";
}

TEST_F(DoctorScan, WarnsIfTheDirectionIsNotDetermined) {
  std::string square(16, '\0');
  for (const auto& [x, y] : {std::pair<float, float>{10, 0}, {-10, 0}, {0, 10}, {0, -10}}) {
    const float point[4] = {x, y, 0, 0};
    square.append(reinterpret_cast<const char*>(point), sizeof point);
  }
  write_file(dir / "square.bin", square);
  const auto result = run_ok("doctor " + quoted(dir / "square.bin"));
  EXPECT_HAS(result.out, "near 1: the principal direction is not determined");
}

TEST_F(DoctorScan, BadInputIsExitCode3AndLeavesNothing) {
  const fs::path out = dir / "out";
  write_file(dir / "short.bin", small_scan().substr(0, 1001));
  write_file(dir / "two.bin", small_scan().substr(16, 32));
  write_file(dir / "none.png", "");
  for (const char* const name : {"short.bin", "two.bin", "none.png"}) {
    expect_exit(3, {(dir / name).string()},
                "doctor " + quoted(dir / name) + " --images " + quoted(out));
  }
  EXPECT_FALSE(fs::exists(out));
}

TEST_F(DoctorScan, MisuseIsExitCode2) {
  const std::pair<const char*, const char*> cases[] = {
      {" --sensor hdl46", "did you mean 'hdl64'"},
      {" --align case3", "did you mean"},
      {" --geometry width=0", "width from 1"},
      {" --geometry closing-width=-4", "0 to 360 degrees"},
      {" --sensor hdl64 --geometry top=-30", "top -30, bottom -25"},
      {" extra", "unexpected argument"}};
  for (const auto& [arguments, says] : cases) {
    expect_exit(2, {says}, command + arguments);
  }
  EXPECT_EQ(run_revisit("doctor --images " + quoted(dir / "out")).exit_code, 2);
}

TEST_F(DoctorScan, UnwritableOutputFails) {
  expect_exit(1, {"cannot create"}, command + " --images " + quoted(dir / "a.bin" / "x"));
}

TEST_F(DoctorScan, RealScansOfEveryKind) {
  REVISIT_NEED_SHARED(data, "data");
  const std::pair<const char*, const char*> scans[] = {
      {"kitti/sequences/00/velodyne/000052.bin", "hdl64"},
      {"other_lidars/hdl64_binary_compressed.pcd", "hdl64"},
      {"other_lidars/hdl32_with_origin_points.pcd", "hdl32"},
      {"other_lidars/vlp16_like_with_nan.pcd", "vlp16"}};
  for (const auto& [scan, sensor] : scans) {
    const auto result = run_ok("doctor " + quoted(data / scan) + " --sensor " + sensor +
                               " --images " + quoted(dir.path()));
    EXPECT_EQ(result.err, "") << scan;
    EXPECT_TRUE(fs::exists(dir / (fs::path(scan).stem().string() + "_closed.png"))) << scan;
  }
}

}  // namespace
}  // namespace revisit
