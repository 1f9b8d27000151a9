#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "expect_error.h"
#include "revisit/datasets/scan_file.h"
#include "test_data.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;
using test::ProgramResult;
using test::run_revisit;
using test::TempDir;

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

TEST(ImageCommand, WritesBothImagesAndATable) {
  const TempDir dir;
  test::write_file(dir / "000007.bin", small_scan());
  const fs::path out = dir / "new/folder";
  const ProgramResult result =
      run_revisit("image " + quoted(dir / "000007.bin") + " -o " + quoted(out));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.err, "");
  for (const char* const name : {"000007_projected.png", "000007_closed.png"}) {
    EXPECT_HAS(result.out, (out / name).string());
    EXPECT_EQ(test::read_file(out / name).substr(1, 3), "PNG") << name;
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(out), fs::directory_iterator()), 2);
  EXPECT_HAS(result.out, "usable points     1000\n");
  EXPECT_HAS(result.out, "4000 x 112, auto");
  EXPECT_HAS(result.out, "eigenvalue ratio");
}

TEST(ImageCommand, JsonHasTheFieldsOfTheReport) {
  const TempDir dir;
  test::write_file(dir / "a.bin", small_scan());
  const std::string command = "image " + quoted(dir / "a.bin") + " -o " + quoted(dir.path()) +
                              " --format json --sensor vlp16 --geometry width=1000,closing-width=0";
  const ProgramResult result = run_revisit(command + " --align case2");
  EXPECT_EQ(result.exit_code, 0) << result.err;
  for (const char* const part :
       {"\"width\": 1000", "\"height\": 112", "\"points\": 1001", "\"usable_points\": 1000",
        "\"align\": \"case2\"", "\"sensor\": \"vlp16\"", "\"yaw_deg\": "})
    EXPECT_HAS(result.out, part);

  const ProgramResult unaligned = run_revisit(command + " --align none");
  EXPECT_EQ(unaligned.exit_code, 0) << unaligned.err;
  EXPECT_EQ(unaligned.out.find("yaw_deg"), std::string::npos) << "not computed, so left out";
}

TEST(ImageCommand, GammaBrightensWhatIsLookedAt) {
  const TempDir dir;
  test::write_file(dir / "a.bin", small_scan());
  const std::string command = "image " + quoted(dir / "a.bin") + " --format json -o ";
  const ProgramResult plain = run_revisit(command + quoted(dir / "plain"));
  const ProgramResult bright = run_revisit(command + quoted(dir / "bright") + " --gamma 2");
  ASSERT_EQ(bright.exit_code, 0) << bright.err;
  const auto before = read_gray_png(dir / "plain/a_projected.png");
  const auto after = read_gray_png(dir / "bright/a_projected.png");
  ASSERT_EQ(before.pixels.size(), after.pixels.size());
  for (size_t i = 0; i < before.pixels.size(); ++i)
    ASSERT_NEAR(after.pixels[i], std::sqrt(255.0 * before.pixels[i]), 3) << i;
  EXPECT_EQ(run_revisit(command + quoted(dir / "x") + " --gamma 0").exit_code, 2);
}

TEST(ImageCommand, WarnsWhenTheDirectionIsNotDetermined) {
  const TempDir dir;
  std::string square(16, '\0');
  for (const auto& [x, y] : {std::pair<float, float>{10, 0}, {-10, 0}, {0, 10}, {0, -10}}) {
    const float point[4] = {x, y, 0, 0};
    square.append(reinterpret_cast<const char*>(point), sizeof point);
  }
  test::write_file(dir / "square.bin", square);
  const ProgramResult result =
      run_revisit("image " + quoted(dir / "square.bin") + " -o " + quoted(dir.path()));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_HAS(result.out, "eigenvalue ratio near 1");
}

TEST(ImageCommand, BadInputIsExitCode3AndLeavesNothing) {
  const TempDir dir;
  const fs::path out = dir / "out";
  test::write_file(dir / "short.bin", small_scan().substr(0, 1001));
  test::write_file(dir / "two.bin", small_scan().substr(16, 32));
  for (const char* const name : {"short.bin", "two.bin", "none.bin", "none.png"}) {
    const ProgramResult result = run_revisit("image " + quoted(dir / name) + " -o " + quoted(out));
    EXPECT_EQ(result.exit_code, 3) << name << ": " << result.err;
    EXPECT_EQ(result.out, "");
    EXPECT_HAS(result.err, (dir / name).string());
  }
  EXPECT_FALSE(fs::exists(out));
}

TEST(ImageCommand, MisuseIsExitCode2) {
  const TempDir dir;
  test::write_file(dir / "a.bin", small_scan());
  const std::string command = "image " + quoted(dir / "a.bin") + " -o " + quoted(dir / "out");
  const std::pair<const char*, const char*> cases[] = {
      {" --sensor hdl46", "did you mean 'hdl64'"},
      {" --align case3", "did you mean"},
      {" --format xml", "expected table or json"},
      {" --geometry width=0", "width from 1"},
      {" --geometry closing-width=-4", "0 to 360 degrees"},
      {" --sensor hdl64 --geometry top=-30", "top -30, bottom -25"},
      {" extra", "unexpected argument"}};
  for (const auto& [arguments, says] : cases) {
    const ProgramResult result = run_revisit(command + arguments);
    EXPECT_EQ(result.exit_code, 2) << arguments << result.err;
    EXPECT_HAS(result.err, says);
  }
  EXPECT_EQ(run_revisit("image").exit_code, 2);
  const ProgramResult help = run_revisit("image --help");
  EXPECT_EQ(help.exit_code, 0);
  EXPECT_HAS(help.out, "Examples:");
}

TEST(ImageCommand, UnwritableOutputFails) {
  const TempDir dir;
  test::write_file(dir / "a.bin", small_scan());
  const ProgramResult result =
      run_revisit("image " + quoted(dir / "a.bin") + " -o " + quoted(dir / "a.bin" / "x"));
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_HAS(result.err, "cannot create");
}

TEST(ImageCommand, RealScansOfEveryKind) {
  REVISIT_NEED_SHARED(data, "data");
  const TempDir dir;
  const std::pair<const char*, const char*> scans[] = {
      {"kitti/sequences/00/velodyne/000052.bin", "hdl64"},
      {"other_lidars/hdl64_binary_compressed.pcd", "hdl64"},
      {"other_lidars/hdl32_with_origin_points.pcd", "hdl32"},
      {"other_lidars/vlp16_like_with_nan.pcd", "vlp16"}};
  for (const auto& [scan, sensor] : scans) {
    const ProgramResult result = run_revisit("image " + quoted(data / scan) + " --sensor " +
                                             sensor + " -o " + quoted(dir.path()));
    EXPECT_EQ(result.exit_code, 0) << scan << result.err;
    EXPECT_EQ(result.err, "") << scan;
    EXPECT_TRUE(fs::exists(dir / (fs::path(scan).stem().string() + "_closed.png"))) << scan;
  }
}

}  // namespace
}  // namespace revisit
