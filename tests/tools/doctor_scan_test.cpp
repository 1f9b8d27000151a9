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

TEST(DoctorScan, PrintsTheScanAndWritesBothImages) {
  const TempDir dir;
  write_file(dir / "000007.bin", small_scan());
  const fs::path out = dir / "new/folder";
  const std::string command = "doctor " + quoted(dir / "000007.bin");
  const auto result = run_ok(command + " --images " + quoted(out));
  EXPECT_EQ(result.err, "");
  for (const char* const name : {"000007_projected.png", "000007_closed.png"}) {
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

TEST(DoctorScan, GammaBrightensTheImages) {
  const TempDir dir;
  write_file(dir / "a.bin", small_scan());
  const std::string command = "doctor " + quoted(dir / "a.bin") + " --images ";
  const ProgramResult plain = run_revisit(command + quoted(dir / "plain"));
  const auto bright = run_ok(command + quoted(dir / "bright") + " --gamma 2");
  const auto before = read_gray_png(dir / "plain/a_projected.png");
  const auto after = read_gray_png(dir / "bright/a_projected.png");
  ASSERT_EQ(before.pixels.size(), after.pixels.size());
  for (size_t i = 0; i < before.pixels.size(); ++i)
    ASSERT_NEAR(after.pixels[i], std::sqrt(255.0 * before.pixels[i]), 3) << i;
}

TEST(DoctorScan, WarnsIfTheDirectionIsNotDetermined) {
  const TempDir dir;
  std::string square(16, '\0');
  for (const auto& [x, y] : {std::pair<float, float>{10, 0}, {-10, 0}, {0, 10}, {0, -10}}) {
    const float point[4] = {x, y, 0, 0};
    square.append(reinterpret_cast<const char*>(point), sizeof point);
  }
  write_file(dir / "square.bin", square);
  const auto result = run_ok("doctor " + quoted(dir / "square.bin"));
  EXPECT_HAS(result.out, "near 1: the principal direction is not determined");
}

TEST(DoctorScan, BadInputIsExitCode3AndLeavesNothing) {
  const TempDir dir;
  const fs::path out = dir / "out";
  write_file(dir / "short.bin", small_scan().substr(0, 1001));
  write_file(dir / "two.bin", small_scan().substr(16, 32));
  write_file(dir / "none.png", "");
  for (const char* const name : {"short.bin", "two.bin", "none.png"}) {
    const ProgramResult result =
        run_revisit("doctor " + quoted(dir / name) + " --images " + quoted(out));
    EXPECT_EQ(result.exit_code, 3) << name << ": " << result.err;
    EXPECT_HAS(result.err, (dir / name).string());
  }
  EXPECT_FALSE(fs::exists(out));
}

TEST(DoctorScan, MisuseIsExitCode2) {
  const TempDir dir;
  write_file(dir / "a.bin", small_scan());
  const std::string command = "doctor " + quoted(dir / "a.bin");
  const std::pair<const char*, const char*> cases[] = {
      {" --sensor hdl46", "did you mean 'hdl64'"},
      {" --align case3", "did you mean"},
      {" --gamma 0", "expected a positive number"},
      {" --geometry width=0", "width from 1"},
      {" --geometry closing-width=-4", "0 to 360 degrees"},
      {" --sensor hdl64 --geometry top=-30", "top -30, bottom -25"},
      {" extra", "unexpected argument"}};
  for (const auto& [arguments, says] : cases) {
    expect_exit(2, {says}, command + arguments);
  }
  EXPECT_EQ(run_revisit("doctor --images " + quoted(dir / "out")).exit_code, 2);
}

TEST(DoctorScan, UnwritableOutputFails) {
  const TempDir dir;
  write_file(dir / "a.bin", small_scan());
  expect_exit(1, {"cannot create"},
              "doctor " + quoted(dir / "a.bin") + " --images " + quoted(dir / "a.bin" / "x"));
}

TEST(DoctorScan, RealScansOfEveryKind) {
  REVISIT_NEED_SHARED(data, "data");
  const TempDir dir;
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
