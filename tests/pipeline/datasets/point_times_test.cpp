#include <cmath>
#include <limits>

#include "revisit/datasets/dataset.h"
#include "testing.h"

namespace revisit {
namespace {

constexpr double kStamp = 1726578368.25, kNan = std::numeric_limits<double>::quiet_NaN();
constexpr int kPoints = 1000;

/// Scans of kPoints with a period of `step`; `value` takes time since the start of the scan, and
/// the stamp [s].
std::vector<RecordedTimes> scans_of(const std::function<double(double since, double stamp)>& value,
                                    double step = 0.1, int scans = 4, double length = 0.1,
                                    const std::string& field = "t") {
  std::vector<RecordedTimes> recorded;
  for (int scan = 0; scan < scans; ++scan) {
    const double stamp = kStamp + scan * step;
    recorded.push_back({.field = field, .stamp = stamp});
    for (int i = 0; i < kPoints; ++i)
      recorded.back().values.push_back(value(length * i / kPoints, stamp));
  }
  return recorded;
}

double of_uint32(double value) {
  return static_cast<double>(static_cast<uint32_t>(std::llround(value)));
}

double of_float(double value) {
  return static_cast<double>(static_cast<float>(value));
}

struct Convention {
  const char* name;
  std::function<double(double since, double stamp)> value;
  const char* text;   // after "field t, ", or the reason
  double first = 0;   // of the times [s]
  double step = 0.1;  // between stamps [s]; 0: one scan
  double length = 0.1;
  std::string unit = "auto";
};

TEST(PointTimes, EveryConventionOfDriversIsFound) {
  const std::vector<Convention> conventions = {
      {"uint32 ns", [](double t, double) { return of_uint32(t * 1e9); }, "ns"},
      {"uint32 us", [](double t, double) { return of_uint32(t * 1e6); }, "us"},
      {"float ms", [](double t, double) { return of_float(t * 1e3); }, "ms"},
      {"float us", [](double t, double) { return of_float(t * 1e6); }, "us"},
      {"float ns", [](double t, double) { return of_float(t * 1e9); }, "ns"},
      {"float s", [](double t, double) { return of_float(t); }, "s"},
      {"a single scan", [](double t, double) { return of_float(t * 1e6); }, "us", 0, 0},
      {"keyframes", [](double t, double) { return of_float(t); }, "s", 0, 1},
      {"20 Hz", [](double t, double) { return t * 1e9; }, "ns", 0, 0.05, 0.05},
      {"a sector", [](double t, double) { return t * 1e3; }, "ms", 0, 0.1, 0.02},
      {"stamp in the middle", [](double t, double) { return t - 0.05; }, "s", -0.05},
      {"stamp at the end", [](double t, double) { return t - 0.1; }, "s", -0.1},
      {"0 to 1", [](double t, double) { return t / 0.1; }, "0 to 1 of a scan of 100 ms"},
      {"0 to 1 at 20 Hz", [](double t, double) { return t / 0.05; }, "0 to 1 of a scan of 50 ms", 0,
       0.05, 0.05},
      {"0 to 1 of keyframes", [](double t, double) { return t / 0.1; },
       "0 to 1 of a scan of 100 ms", 0, 1},
      {"0 to 1, one scan", [](double t, double) { return t / 0.1; }, "0 to 1 of a scan of 100 ms",
       0, 0},
      {"-1 to 0", [](double t, double) { return t / 0.1 - 1; }, "0 to 1 of a scan of 100 ms", -0.1},
      {"clock, s", [](double t, double s) { return s + t; }, "s of the clock of the stamps"},
      {"clock, ms", [](double t, double s) { return (s + t) * 1e3; },
       "ms of the clock of the stamps"},
      {"clock, us", [](double t, double s) { return std::floor((s + t) * 1e6); },
       "us of the clock of the stamps"},
      {"clock, ns", [](double t, double s) { return (s + t) * 1e9; },
       "ns of the clock of the stamps"},
      {"clock, end stamp", [](double t, double s) { return s + t - 0.1; },
       "s of the clock of the stamps", -0.1},
      {"clock, one scan", [](double t, double s) { return s + t - 0.05; },
       "s of the clock of the stamps", -0.05, 0},
      {"TAI", [](double t, double s) { return s + 37 + t; },
       "s of a clock 37 s ahead (TAI or GPS)"},
      {"stamps of TAI, at the end", [](double t, double s) { return (s - 37 + t - 0.1) * 1e9; },
       "ns of a clock 37 s behind (TAI or GPS)", -0.1},
      {"time since boot", [](double t, double s) { return (s - kStamp + 5000 + t) * 1e6; },
       "us of another clock, from the earliest point"},
      {"boot in the first scan", [](double t, double s) { return (s - kStamp + t) * 1e9; },
       "ns of another clock, from the earliest point"},
      {"float32 clock", [](double t, double s) { return of_float(s + t); },
       "none, because field t has no resolution: 1 value in a scan"},
      {"whole seconds", [](double, double s) { return std::floor(s); },
       "none, because field t has no resolution: 1 value in a scan"},
      {"whole seconds, two", [](double t, double s) { return std::floor(s + 10 * t); },
       "none, because field t has no resolution: 2 values in a scan"},
      {"no unit", [](double t, double) { return 30 * t; },
       "none, because field t spans 2.997 in a scan and scans are 100 ms apart, which fits no "
       "unit; "
       "give --point-times"},
      {"given unit", [](double t, double) { return 10 * t; }, "s", 0, 0.1, 0.05, "s"},
      {"none", [](double t, double) { return t; }, "none, as given", 0, 0.1, 0.1, "none"},
  };
  for (const Convention& c : conventions) {
    SCOPED_TRACE(c.name);
    const auto scans = scans_of(c.value, c.step, c.step == 0 ? 1 : 4, c.length);
    const PointTimes found = point_times_of(scans, c.unit);
    const std::string text = c.text;
    EXPECT_EQ(found.text, text.starts_with("none") ? text : "field t, " + text);
    for (const RecordedTimes& scan : scans) {
      const std::vector<float> times = found.of(scan.values, scan.stamp);
      EXPECT_EQ(times.empty(), text.starts_with("none"));
      if (times.empty()) continue;
      const double scale = c.unit == "s" ? 10 : 1;
      EXPECT_NEAR(times.front(), c.first, 2e-6);
      EXPECT_NEAR(times.back(), c.first + scale * c.length * (kPoints - 1) / kPoints, 2e-6);
    }
  }
}

TEST(PointTimes, AFewInvalidValuesAreNan) {
  const auto lost_with = [](auto damage, int lost) {
    auto scans = scans_of([](double t, double) { return of_uint32(t * 1e9); });
    for (RecordedTimes& scan : scans) damage(scan.values);
    const PointTimes found = point_times_of(scans);
    EXPECT_EQ(found.text, "field t, ns");
    const std::vector<float> times = found.of(scans[1].values, scans[1].stamp);
    ASSERT_EQ(times.size(), kPoints);
    EXPECT_EQ(std::ranges::count_if(times, [](float t) { return std::isnan(t); }), lost);
    EXPECT_NEAR(times[998], 0.0998, 1e-6);
  };
  lost_with(
      [](auto& values) {
        for (size_t i = 0; i < values.size(); i += 7) values[i] = 0;
      },
      143);
  lost_with([](auto& values) { std::fill_n(values.begin() + 5, 35, 4.2e9); }, 35);
  lost_with([](auto& values) { values[3] = kNan; }, 1);
  lost_with([](auto&) {}, 0);
  // Absolute times: points without a return have 0.
  auto scans = scans_of([](double t, double s) { return s + t; });
  scans[0].values[10] = 0;
  const std::vector<float> times = point_times_of(scans).of(scans[0].values, scans[0].stamp);
  EXPECT_TRUE(std::isnan(times.at(10)));
  EXPECT_NEAR(times.at(11), 0.0011, 1e-6);
}

TEST(PointTimes, TheConventionIsThatOfMostScans) {
  auto scans = scans_of([](double t, double) { return t * 1e6; }, 0.1, 5);
  std::ranges::fill(scans[0].values, 7);
  for (double& value : scans[1].values) value *= 1e3;
  const PointTimes found = point_times_of(scans);
  EXPECT_EQ(found.text, "field t, us");
  EXPECT_TRUE(found.of(scans[0].values, scans[0].stamp).empty());
  EXPECT_TRUE(found.of(scans[1].values, scans[1].stamp).empty()) << "100 s long";
  EXPECT_FALSE(found.of(scans[4].values, scans[4].stamp).empty());
  EXPECT_EQ(point_times_of({}).text, "none");
  EXPECT_THROW(point_times_of(scans, "minutes"), UsageError);
}

/// The same name is a measure of shape in other clouds.
TEST(PointTimes, CurvatureIsATimeInCloudsOfLioOnly) {
  const auto text = [](const std::function<double(double, double)>& value) {
    return point_times_of(scans_of(value, 0.1, 4, 0.1, "curvature")).text;
  };
  EXPECT_EQ(text([](double t, double) { return t * 1e3; }), "field curvature, ms");
  EXPECT_TRUE(text([](double t, double) { return t * 3; }).starts_with("none"));
  EXPECT_TRUE(text([](double t, double) { return 90 * std::pow(10 * t, 8); }).starts_with("none"));
}

TEST(PointTimes, FilesOfADataSetHaveOneConvention) {
  const TempDir dir;
  const auto write = [&](int scan, const std::string& fields, const auto& line) {
    std::string text = "FIELDS x y z " + fields +
                       "\nSIZE 4 4 4 8 8\nTYPE F F F U U\nCOUNT 1 1 1 1 1\n" +
                       "WIDTH 100\nDATA ascii\n";
    for (int i = 0; i < 100; ++i) text += str("1 2 3 ", line(i), "\n");
    write_file(dir / str(1700000000 + scan / 10, "_", scan % 10, "00000000.pcd"), text);
  };
  for (int scan = 0; scan < 3; ++scan)
    write(scan, "timestampSec timestampNsec",
          [&](int i) { return str("1700000000 ", scan * 100000000 + i * 1000000); });
  Dataset dataset = open_dataset(dir.path(), "");
  find_point_times(dataset);
  EXPECT_EQ(dataset.point_times, "field timestampSec, ns of the clock of the stamps");
  for (const ScanRef& scan : dataset.scans) EXPECT_NEAR(read_scan(scan).times.at(99), 0.099, 1e-6);
  find_point_times(dataset, "none");
  EXPECT_TRUE(read_scan(dataset.scans[0]).times.empty());
}

}  // namespace
}  // namespace revisit
