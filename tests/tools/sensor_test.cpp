#include "small_drive.h"
#include "testing.h"

namespace revisit {
namespace {

/// A drive with 16 beams from +15 to -15 degrees: 6 of them are above the image of an HDL-64E.
class SensorOption : public testing::Test {
 protected:
  SensorOption() { write_small_drive(root(), 24, {15, 2, 16}); }
  fs::path root() const { return dir_ / "drive"; }
  fs::path scan() const { return root() / "sequences/00/velodyne/000003.bin"; }
  std::string eval(const std::string& more = "") const { return eval_of(root(), more); }
  std::string eval_of(const fs::path& drive, const std::string& more) const {
    return "eval " + drive.string() +
           " --feature data --geometry width=400 --protocol online --exclusion frames=8 --radius 2 "
           "--no-report -o " +
           (dir_ / "results").string() + " " + more;
  }
  std::string describe(const std::string& more = "") const {
    return "eval " + root().string() + " --feature data --geometry width=400 --descriptors " +
           (dir_ / "described").string() + " " + more;
  }
  static size_t count(const std::string& text, const std::string& part) {
    size_t n = 0;
    for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++n;
    return n;
  }

  const TempDir dir_;
};

constexpr const char* kOutside = "of a scan's points are outside of the range image";

TEST_F(SensorOption, PointsOutsideOfTheImageAreSaidOnceWithTheSensorThatFits) {
  for (const std::string& command : {eval("--sensor hdl64"), describe("--sensor hdl64")}) {
    const auto result = run_ok(command);
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

TEST_F(SensorOption, DoctorSaysItToo) {
  const std::string doctor = "doctor " + scan().string() + " --align none";
  const auto wrong = run_revisit(doctor + " --sensor hdl64");
  const std::string field = "\n  outside ";
  ASSERT_NE(wrong.out.find(field), std::string::npos) << wrong.out;
  // 6 beams of 16, and some of the points of the one at +3 degrees, on the edge [%].
  EXPECT_NEAR(std::stod(wrong.out.substr(wrong.out.find(field) + field.size())), 40, 3.5);
  EXPECT_HAS(wrong.out, "--sensor vlp16");
  EXPECT_EQ(count(run_revisit(doctor + " --sensor vlp16").out, kOutside), 0U);
}

TEST_F(SensorOption, TheWholeGeometryIsOneSetOfOptions) {
  const std::string geometry =
      " --sensor hdl32 --geometry top=20,bottom=-20,width=1000,height=80,max-range=60,"
      "closing-width=1.8,closing-height=2.5";
  run_ok(eval(geometry));
  run_ok(describe(geometry));
  EXPECT_HAS(run_ok("doctor " + scan().string() + geometry).out, "1000 x 80, hdl32");
  const std::string eval_json = read_file(dir_ / "results/drive_00/latest/run.json");
  for (const std::string& json : {eval_json, read_file(dir_ / "described/run.json")})
    for (const char* part :
         {"\"image_width\": 1000", "\"image_height\": 80", "\"elevation_top_deg\": 20",
          "\"elevation_bottom_deg\": -20", "\"max_range_m\": 60", "\"closing_width\": 5",
          "\"closing_height\": 5", "\"sensor\": \"hdl32\""})
      EXPECT_HAS(json, part);
  EXPECT_HAS(eval_json, "closing-height=2.5");
  EXPECT_HAS(eval_json, "\"geometry\": \"bottom=-20,");
}

TEST_F(SensorOption, ListNamesThemWithoutData) {
  for (const char* command : {"doctor", "eval"}) {
    const auto result = run_ok(std::string(command) + " --sensor list");
    EXPECT_HAS(result.out, "ouster-os1-128");
    EXPECT_HAS(result.out, "Livox Mid-360");
  }
}

TEST_F(SensorOption, AutoFindsTheSensorAndSaysSo) {
  const std::string seen = "note: sensor: 16 beams from +15.0 to -15.0 degrees: vlp16";
  for (const std::string& command : {eval(), describe()}) {
    const auto result = run_ok(command);
    EXPECT_EQ(count(result.err, seen), 1U) << result.err;
    EXPECT_EQ(count(result.err, kOutside), 0U) << result.err;
  }
  const std::string json = read_file(dir_ / "results/drive_00/latest/run.json");
  EXPECT_HAS(json, "\"sensor\": \"vlp16\"");
  EXPECT_HAS(json, "--sensor vlp16") << "of the command that repeats it";
  EXPECT_EQ(count(run_revisit(eval("--quiet")).err, "sensor"), 0U);
  EXPECT_EQ(count(run_revisit(eval("--feature m2dp")).err, "sensor"), 0U) << "sees no image";
  const auto image = run_ok("doctor " + scan().string());
  EXPECT_HAS(image.out, "4000 x 112, vlp16");
  EXPECT_HAS(image.out, "ring model        vlp16 (16 beams, ");
  EXPECT_HAS(image.out, "16 beams from +15.0 to -15.0 degrees");
}

TEST_F(SensorOption, AutoMakesAnImageForAnUnknownSensorAndRepeatsIt) {
  const fs::path other = dir_ / "other";
  write_small_drive(other, 24, {30, 4, 10});
  expect_exit(0,
              {"10 beams from +30.0 to -6.0 degrees: not a known sensor, so --geometry "
               "bottom=-8.5,closing-height="},
              eval_of(other, ""));
  const fs::path run = dir_ / "results/other_00/latest";
  const auto again = run_ok("eval " + other.string() + " --config " + (run / "run.json").string() +
                            " --no-report -o " + (dir_ / "again").string());
  const auto tasks_of = [](const std::string& json) { return json.substr(json.find("\"tasks\"")); };
  EXPECT_EQ(tasks_of(read_file(dir_ / "again/other_00/latest/run.json")),
            tasks_of(read_file(run / "run.json")));
  EXPECT_EQ(count(again.err, kOutside), 0U);
}

TEST(SensorAuto, RealScansOfKittiAreAnHdl64) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  const TempDir dir;
  const std::string eval = "eval " + kitti.string() +
                           " --sequence 00 --protocol leave-one-out --exclusion none --feature "
                           "data --no-report --format json --cache " +
                           (dir / "cache").string() + " -o " + (dir / "results").string();
  expect_exit(0, {": hdl64"}, eval);
  const auto files = std::distance(fs::directory_iterator(dir / "cache"), {});
  run_ok(eval + " --sensor hdl64");
  EXPECT_EQ(std::distance(fs::directory_iterator(dir / "cache"), {}), files)
      << "the same features and descriptors";
}

}  // namespace
}  // namespace revisit
