// What the program says of scans that do not fit the range image.
#include <gtest/gtest.h>

#include "small_drive.h"
#include "test_data.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;
using test::run_revisit;

#define EXPECT_HAS(text, part) \
  EXPECT_NE((text).find(part), std::string::npos) << "'" << (text) << "' lacks '" << (part) << "'"

#define ASSERT_HAS(text, part) \
  ASSERT_NE((text).find(part), std::string::npos) << "'" << (text) << "' lacks '" << (part) << "'"

/// A drive with 16 beams from +15 to -15 degrees: 6 of them are above the image of an HDL-64E.
class SensorOption : public testing::Test {
 protected:
  SensorOption() { test::write_small_drive(root(), 24, {15, 2, 16}); }
  fs::path root() const { return dir_ / "drive"; }
  std::string eval(const std::string& more = "") const {
    return "eval " + root().string() +
           " --feature data --width 400 --protocol online --exclusion frames=8 --radius 2 "
           "--no-plots -o " +
           (dir_ / "results").string() + " " + more;
  }
  std::string describe(const std::string& more = "") const {
    return "describe " + root().string() + " --feature data --width 400 -o " +
           (dir_ / "described").string() + " " + more;
  }
  static size_t count(const std::string& text, const std::string& part) {
    size_t n = 0;
    for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++n;
    return n;
  }

  const test::TempDir dir_;
};

constexpr const char* kOutside = "of a scan's points are outside of the image";

TEST_F(SensorOption, PointsOutsideOfTheImageAreSaidOnceWithTheSensorThatFits) {
  for (const std::string& command : {eval("--sensor hdl64"), describe("--sensor hdl64")}) {
    const auto result = run_revisit(command);
    ASSERT_EQ(result.exit_code, 0) << result.err;
    EXPECT_EQ(count(result.err, kOutside), 1U) << result.err;
    EXPECT_HAS(result.err, "warning: 41 % of a scan's points");
    EXPECT_HAS(result.err, "spans 3.0 to -25.0 degrees");
    EXPECT_HAS(result.err, "--sensor vlp16");
    EXPECT_HAS(result.err, "(median of 24 scans)");
  }
  EXPECT_HAS(run_revisit(eval("--sensor hdl64")).err, kOutside) << "the features were in the cache";
  for (const std::string& command :
       {eval("--sensor vlp16"), describe("--sensor vlp16"), eval("--sensor hdl64 --quiet"),
        eval("--sensor hdl64 --feature m2dp")})
    EXPECT_EQ(count(run_revisit(command).err, kOutside), 0U) << command;
}

TEST_F(SensorOption, TheImageCommandSaysItToo) {
  const std::string scan = (root() / "sequences/00/velodyne/000003.bin").string();
  const std::string image = "image " + scan + " --align none -o " + dir_.path().string();
  const auto json = run_revisit(image + " --sensor hdl64 --format json");
  const std::string field = "\"points_outside\": ";
  ASSERT_HAS(json.out, field);
  // 6 beams of 16, and some of the points of the one at +3 degrees, on the edge.
  EXPECT_NEAR(std::stod(json.out.substr(json.out.find(field) + field.size())), 0.4, 0.035);
  EXPECT_HAS(json.out, "--sensor vlp16");
  EXPECT_HAS(run_revisit(image + " --sensor hdl64").out, "\noutside  ");
  EXPECT_EQ(count(run_revisit(image + " --sensor vlp16").out, kOutside), 0U);
}

}  // namespace
}  // namespace revisit
