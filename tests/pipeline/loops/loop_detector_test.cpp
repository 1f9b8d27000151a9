#include "revisit/loops/loop_detector.h"

#include <span>

#include "execute_sql.h"
#include "local_map.h"
#include "maps.h"
#include "revisit/recognition/align.h"
#include "testing.h"

namespace revisit {
namespace {

/// Scans of one entry have equal first points.
FeatureExtractor first_point(std::optional<double> same_place = {}) {
  FeatureExtractor extractor;
  extractor.comparison.same_place = same_place;
  extractor.name = extractor.key = "first point";
  extractor.dim = 3;
  extractor.make = []() -> FeatureFunction<PointCloud> {
    return [](const PointCloud& cloud, std::span<float> feature) {
      if (cloud.points.size() < 2) throw InputError("fewer than two points");
      feature[0] = cloud.points[0].x;
      feature[1] = cloud.points[0].y;
      feature[2] = cloud.points[0].z;
    };
  };
  extractor.comparison.relative_yaw = [](std::span<const float>, std::span<const float>) {
    return 0.0;
  };
  return extractor;
}

/// A room with walls and pillars; rooms with the same angle [rad] are one entry.
PointCloud room(double angle) {
  PointCloud cloud;
  const auto add = [&](double x, double y, double z) {
    cloud.points.push_back(
        {static_cast<float>(x), static_cast<float>(y), static_cast<float>(z), 0});
  };
  add(20 * std::cos(angle), 20 * std::sin(angle), 0);
  for (double along = -10; along <= 10; along += 0.25)
    for (double z = -1.5; z <= 3; z += 0.25) {
      add(10, along, z);
      add(-10, along, z);
      add(along, 8, z);
      add(along, -8, z);
      add(along, 4 * z - 3, -1.5);  // floor
    }
  return cloud;
}

const Exclusion kNone = parse_exclusion("none");

/// Its walls are farther along x.
PointCloud stretched(double angle, float factor) {
  PointCloud cloud = room(angle);
  for (size_t i = 1; i < cloud.points.size(); ++i) cloud.points[i].x *= factor;
  return cloud;
}

ScanStamp stamp_at(double x, int64_t frame) {
  return {.frame = frame, .time = {}, .pose = Eigen::Isometry3d(Eigen::Translation3d(x, 0, 0))};
}

/// Below the frames that tests give.
ScanStamp next_stamp() {
  static int64_t frame = -1'000'000;
  return {.frame = ++frame};
}

Detection take(LoopDetector& detector, double angle, const ScanStamp& stamp = next_stamp()) {
  return detector.take(view_of(room(angle)), stamp);
}

int64_t match_of(LoopDetector& detector, double angle, const ScanStamp& stamp = next_stamp()) {
  const Detection found = take(detector, angle, stamp);
  EXPECT_TRUE(found.index) << found.error;
  return found.loop ? found.loop->index : -1;
}

/// On a temporary map.
struct OnMap {
  explicit OnMap(const LoopDetectorOptions& options = {.exclusion = kNone},
                 const MapOptions& of_map = {}, const FeatureExtractor& extractor = first_point())
      : map(extractor, of_map), detector(map, options) {}
  Map map;
  LoopDetector detector;
};

TEST(LoopDetector, ExcludesRecentScans) {
  // Loops are more than two frames, one second or four meters apart.
  for (const char* exclusion : {"frames=2", "seconds=1", "meters=4", "none"}) {
    const bool none = exclusion == std::string("none");
    OnMap on({.exclusion = parse_exclusion(exclusion), .verify = false});
    const auto match = [&](int64_t frame, double angle) {
      ScanStamp scan = stamp_at(2.0 * static_cast<double>(frame), frame);
      scan.time = 0.5 * static_cast<double>(frame);
      return match_of(on.detector, angle, scan);
    };
    for (int i = 0; i < 3; ++i) EXPECT_EQ(match(i, 0.1 * i), none ? i - 1 : -1);
    EXPECT_EQ(match(3, 0.3), none ? 2 : 0) << exclusion;
    EXPECT_EQ(match(4, 0.1), 1) << exclusion;
    if (std::string(exclusion).starts_with("seconds"))
      expect_error<UsageError>([&] { take(on.detector, 0, {.frame = 5}); }, {"use frames=N"});
  }
}

/// The room, seen from `x`.
PointCloud seen_from(double x, double angle) {
  PointCloud cloud = room(angle);
  for (size_t i = 1; i < cloud.points.size(); ++i) cloud.points[i].x -= static_cast<float>(x);
  return cloud;
}

TEST(LoopDetector, ExcludesScansByTheirMotion) {
  struct {
    double step;  // [m]
    bool is_registered;
    int excluded;  // scans
  } const cases[] = {{1, true, 3}, {0.1, false, 50}, {0.1, true, 30}, {0, true, 60}};
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  constexpr size_t kCases = 2;  // the others take a minute, for more of the same
#else
  constexpr size_t kCases = std::size(cases);
#endif
  for (const auto& [step, is_registered, excluded] : std::span(cases).first(kCases)) {
    OnMap on({.exclusion = parse_exclusion("meters=3.04"), .verify = is_registered});
    for (int i = 0; i < 60; ++i) {
      const double x = std::abs(std::remainder(step * i + 6, 24)) - 6;  // to and fro, 12 m
      const PointCloud cloud = seen_from(x, 0.1 * i);
      const Detection found = on.detector.take(view_of(cloud), {.frame = i * 1000000000LL});
      if (i == 0) continue;
      const auto nearest = static_cast<double>(i - std::ranges::min(found.excluded));
      EXPECT_NEAR(nearest, std::min(i, excluded), 1) << step << " " << i;
      EXPECT_EQ(found.loop.has_value(), nearest < i) << step << " " << i;
    }
  }
}

TEST(LoopDetector, LocalMapsNeedNoPoses) {
  OnMap on({.exclusion = kNone}, {.local_map = 20});
  for (int i = 0; i < 12; ++i) {
    PointCloud cloud = seen_from(0.5 * i, 0);
    cloud.points.erase(cloud.points.begin());
    // Only the first sees the wall in front.
    if (i > 0) std::erase_if(cloud.points, [&](const Point& p) { return p.x > 9.5 - 0.5 * i; });
    const Detection found = on.detector.take(view_of(cloud), {.frame = i});
    ASSERT_TRUE(found.index) << found.error;
    const int64_t id = on.map.entry(*found.index).id;
    std::string bytes;
    on.map.use_store([&](MapStore& store) { bytes = store.cloud(id); });
    const PointCloud kept = expand_cloud(bytes).first;
    EXPECT_NEAR(std::ranges::max(kept.points, {}, &Point::x).x, 10 - 0.5 * i, 0.3) << i;
  }
}

TEST(LoopDetector, ExcludesTheHaltOfAScan) {
  OnMap on({.exclusion = parse_exclusion("frames=3")}, {}, first_point(0.9));
  int64_t frame = 0;
  const auto match = [&](double angle) { return match_of(on.detector, angle, {.frame = frame++}); };
  EXPECT_EQ(match(2), -1);
  for (int i = 0; i < 20; ++i) EXPECT_LE(match(0), 0) << "only the entry before the halt";
  for (int i = 0; i < 5; ++i) match(3);
  EXPECT_GE(match(0.01), 1) << "back at the halt";
}

TEST(LoopDetector, RegistersSimilarEntries) {
  OnMap on({.drive = "monday", .exclusion = kNone, .verify = true});
  for (const double angle : {0.0, 2.0, 4.0, 5.0}) match_of(on.detector, angle);
  const Detection found = take(on.detector, 2);
  ASSERT_TRUE(found.loop && found.registered);
  EXPECT_EQ(found.loop->index, 1);
  EXPECT_EQ(found.loop->drive, "monday");
  EXPECT_TRUE(found.registered->fits && found.accepted);
  EXPECT_EQ(found.rejection, "");
  // Points are kept in steps of 1/32 m.
  EXPECT_TRUE(found.registered->T_place_query.isApprox(Eigen::Isometry3d::Identity(), 0.01));

  OnMap another({.exclusion = kNone, .verify = true});
  take(another.detector, 2);
  const Detection elsewhere = another.detector.take(view_of(stretched(2, 2.5)), next_stamp());
  ASSERT_TRUE(elsewhere.loop && elsewhere.registered);
  EXPECT_FALSE(elsewhere.registered->fits || elsewhere.accepted);
  EXPECT_EQ(elsewhere.rejection, "registration");
  OnMap other;
  take(other.detector, 0);
  const Detection dissimilar = take(other.detector, 1.35);  // the similarity is 0.22
  EXPECT_FALSE(dissimilar.registered || dissimilar.accepted);
  EXPECT_EQ(dissimilar.rejection, "similarity");
}

/// More points fit along two walls than at a corner, but the scans are unconstrained.
TEST(LoopDetector, PrefersAcceptedRegistrations) {
  for (const double corner_at : {1.0, 1.1}) {  // more similar than the walls, and less
    SCOPED_TRACE(corner_at);
    OnMap on({.exclusion = kNone});
    const auto take = [&](double angle, const auto& is_seen) {
      PointCloud cloud = room(angle);
      std::erase_if(cloud.points, [&](const Point& p) {
        const bool floor = std::abs(p.x) < 9.9F && std::abs(p.y) < 7.9F;
        return !floor && !is_seen(p);
      });
      cloud.points.insert(cloud.points.begin(), room(angle).points[0]);
      return on.detector.take(view_of(cloud), next_stamp());
    };
    take(corner_at, [](const Point& p) { return p.x > 9.9F || (p.y > 7.9F && p.x > -4); });
    take(-1.05, [](const Point& p) { return std::abs(p.x) < 9.9F; });
    const Detection found = take(0, [](const Point&) { return true; });
    ASSERT_TRUE(found.loop && found.registered);
    EXPECT_EQ(found.loop->index, 0);
    EXPECT_TRUE(found.accepted);
    EXPECT_NEAR(found.loop->similarity, std::cos(corner_at), 1e-6);
    EXPECT_NEAR(found.loop->score, 0.1 * 0.4 * found.loop->similarity + 0.03, 0.05);
    EXPECT_EQ(found.loop->probability, verified_calibration().probability(found.loop->score));
  }
}

/// Matches with scores below 0.2 are incorrect, from `correct_from` on correct, in between mostly
/// correct.
Calibration some_calibration(double correct_from, Score score) {
  return {.score = score,
          .trained_on = "a town",
          .blocks = {{-1, 1000, 0}, {0.2, 1000, 600}, {correct_from, 1000, 1000}}};
}

FeatureExtractor calibrated() {
  FeatureExtractor extractor = first_point();
  extractor.calibration = some_calibration(1.1, Score::kMargin);
  return extractor;
}

/// Extends it to `entries` entries.
void add_circle(Map& map, int64_t entries) {
  while (map.size() < entries)
    add_scan(map, map.describe(view_of(room(0.25 * static_cast<double>(map.size())))));
}

TEST(LoopDetector, AcceptsByTheCalibrationOfTheFeature) {
  OnMap on({.verify = false}, {}, calibrated());
  EXPECT_EQ(on.detector.score(), Score::kMargin);
  EXPECT_EQ(on.detector.threshold(), 1.1);
  for (const int64_t entries : {10, 25}) {
    add_circle(on.map, entries);
    const auto n = static_cast<double>(entries);
    int accepted = 0;
    for (double angle = 0; angle < 2; angle += 0.05) {  // at entries and between them
      const Detection found = on.detector.locate(view_of(room(angle))).front();
      // With 10 distinct entries, the next one is new with a probability of 0.09.
      EXPECT_EQ(found.accepted, entries == 25 && found.loop->score >= 1.1);
      EXPECT_EQ(found.rejection, found.accepted ? "" : "score");
      EXPECT_EQ(found.loop->probability,
                std::min(n / (n + 1), calibrated().calibration->probability(found.loop->score)));
      accepted += found.accepted ? 1 : 0;
    }
    EXPECT_EQ(accepted > 0, entries == 25);
    EXPECT_LT(accepted, 40);
  }
  for (const MapOptions& other : {MapOptions{.k = 2}, MapOptions{.score = Score::kSimilarity}}) {
    OnMap uncalibrated({.verify = false}, other, calibrated());
    LoopDetector& detector = uncalibrated.detector;
    add_circle(uncalibrated.map, 25);
    EXPECT_FALSE(detector.threshold() || detector.calibration());
    const Detection found = detector.locate(view_of(room(1))).front();
    EXPECT_FALSE(found.accepted || found.loop->probability);
    expect_error<UsageError>([&] { detector.calibrate(*calibrated().calibration); }, {"k = 4"});
  }
}

TEST(LoopDetector, RejectsInvalidOptions) {
  Map map(first_point(), {});
  for (const double precision : {0.0, 1.0, -1.0, 2.0, std::nan("")})
    expect_error<UsageError>([&] { LoopDetector(map, {.target_precision = precision}); },
                             {"precision"});
  for (const double threshold : {std::nan(""), double{INFINITY}})
    expect_error<UsageError>([&] { LoopDetector(map, {.threshold = threshold}); }, {"threshold"});
  expect_error<UsageError>([&] { LoopDetector(map, {.map = "a.map"}); },
                           {"LoopDetectorOptions::map: a.map", "one of the two"});
  EXPECT_TRUE(LoopDetector(map, {}).verifies());
  EXPECT_FALSE(LoopDetector(map, {.keep_clouds = false}).verifies());
  FeatureExtractor blind = first_point();
  blind.comparison.relative_yaw = nullptr;
  Map without_yaw(blind, {});
  EXPECT_FALSE(LoopDetector(without_yaw, {}).verifies());
  expect_error<UsageError>([&] { LoopDetector(without_yaw, {.verify = true}); }, {"relative yaw"});
}

TEST(LoopDetector, PrefersTheCalibrationOfTheMap) {
  for (const bool verify : {true, false}) {
    SCOPED_TRACE(verify);
    const TempDir dir;
    const Score score = verify ? Score::kVerified : Score::kMargin;
    const Calibration usual = verify ? verified_calibration() : *calibrated().calibration;
    const Calibration own = some_calibration(1.2, score);
    const auto map = file_map(dir / "map", calibrated());
    Map reader(calibrated(), {}, reader_of(dir / "map"));
    LoopDetector following(reader, {.verify = verify}), detector(*map, {.verify = verify});
    EXPECT_EQ(detector.score(), score);
    EXPECT_EQ(detector.threshold(), usual.threshold_for(verify ? 0.99 : 0.95));
    expect_error<UsageError>([&] { detector.calibrate(Calibration{}); }, {"no blocks"});
    EXPECT_EQ(detector.calibration(), usual);
    detector.calibrate(own);
    EXPECT_EQ(detector.threshold(), 1.2);
    const auto threshold = [&](LoopDetectorOptions options) {
      options.verify = verify;
      return LoopDetector(*map, options).threshold();
    };
    EXPECT_EQ(threshold({}), 1.2);
    EXPECT_EQ(threshold({.threshold = 0.1}), 0.1);
    EXPECT_EQ(threshold({.target_precision = 0.7}), 0.2);
    EXPECT_EQ(threshold({.target_precision = 0.9999}), std::nullopt);
    following.locate(view_of(room(1)));
    EXPECT_EQ(following.calibration(), own) << "of another process";
  }
}

/// The map can still be opened, in order to calibrate it again.
TEST(LoopDetector, IgnoresUnusableCalibrationsOfAMap) {
  const std::string other = calibration_content(some_calibration(1.2, Score::kSimilarity));
  const std::string bad = "nonsense";
  for (const auto& [verify, name, content, problem] :
       {std::tuple(false, kCalibrationValue, bad, "a.map: its calibration: not a usable"),
        {true, kVerifiedCalibrationValue, bad, "a.map: its verified calibration: not a usable"},
        {false, kCalibrationValue, other,
         "for k = 4 and the score similarity, not for k = 4 and margin"},
        {true, kVerifiedCalibrationValue, other,
         "for k = 4 and the score similarity, not for k = 4 and verified"},
        {true, kCalibrationValue, other, "is for loops without registration"},
        {false, kCalibrationValue, other, "the checksum of a value is wrong"},
        {true, kVerifiedCalibrationValue, other, "the checksum of a value is wrong"}}) {
    const bool is_corrupt = std::string(problem).ends_with("is wrong");
    SCOPED_TRACE(problem);
    const TempDir dir;
    const fs::path file = dir / "a.map";
    map_in(file, first_point())->set_value(name, content);
    if (is_corrupt)
      execute_sql(file, str("UPDATE value SET bytes = 'x' WHERE name = '", name, "'"));
    EXPECT_EQ(check_map(file).size(), is_corrupt || content == bad ? 1 : 0);
    Map map(calibrated(), {}, map_in(file, first_point()));
    Map reader(calibrated(), {}, open_map(file, MapAccess::kRead));
    std::vector<std::string> warnings;
    LoopDetector detector(reader, {.verify = verify, .warn = into(warnings)});
    for (int i = 0; i < 3; ++i) {
      add_circle(map, i + 1);
      detector.locate(view_of(room(1)));
    }
    EXPECT_EQ(detector.calibration(), verify ? verified_calibration() : *calibrated().calibration);
    ASSERT_EQ(warnings.size(), 1);
    EXPECT_HAS(warnings[0], problem);
    EXPECT_HAS(warnings[0], "ignored; calibrate the map again");
    const Calibration own = some_calibration(1.3, detector.score());
    LoopDetector(map, {.verify = verify, .warn = into(warnings)}).calibrate(own);
    detector.locate(view_of(room(1)));
    EXPECT_EQ(detector.threshold(), 1.3);
  }
}

TEST(LoopDetector, AcceptsNoAmbiguousLoops) {
  OnMap on({.exclusion = kNone, .verify = false}, {}, first_point(0.9));
  for (int i = 0; i < 100; ++i) {  // a tunnel from frame 40 to 80, with two views by turns
    const double angle = i >= 40 && i < 80 ? 0.4 * (i % 2) : i + 0.5;
    take(on.detector, angle, stamp_at(i, i));
  }
  for (const bool verify : {true, false})
    for (const bool in_tunnel : {true, false}) {
      LoopDetector detector(on.map, {.verify = verify, .threshold = -9});
      const Detection found = detector.locate(view_of(room(in_tunnel ? 0 : 1.5))).front();
      ASSERT_TRUE(found.loop);
      EXPECT_FALSE(found.loop->ambiguous && found.accepted);
      if (verify) continue;  // registration looks for other places
      EXPECT_EQ(found.loop->ambiguous, in_tunnel);
      EXPECT_EQ(found.rejection, in_tunnel ? "ambiguous" : "");
      EXPECT_EQ(found.accepted, !in_tunnel);
    }
}

TEST(LoopDetector, LocatesWithoutAdding) {
  OnMap on({.threshold = 0});
  EXPECT_FALSE(on.detector.locate(view_of(room(1))).front().loop);
  EXPECT_EQ(on.detector.locate({}).front().error, "the scan has no points");
  for (const double angle : {1, 2, 3}) match_of(on.detector, angle);
  const std::vector<Detection> places = on.detector.locate(view_of(room(2)));
  ASSERT_EQ(places.size(), 1) << "the others do not fit";
  const Detection& found = places.front();
  ASSERT_TRUE(found.accepted && found.registered && !found.index) << found.rejection;
  EXPECT_EQ(found.loop->index, 1) << "without exclusion";
  EXPECT_EQ(on.map.size(), 3);
  match_of(on.detector, 2);
  EXPECT_TRUE(on.detector.locate(view_of(room(2))).front().accepted) << "two entries, one place";
}

/// Without poses, registration relates them.
TEST(LoopDetector, LocatesBetweenEntriesOfOnePlace) {
  OnMap on({.threshold = 0});
  for (const double x : {-4, 4}) on.detector.take(view_of(seen_from(x, 0.1 * x)), next_stamp());
  EXPECT_TRUE(on.detector.locate(view_of(seen_from(0, 0.1))).front().accepted);
}

TEST(LoopDetector, FindsLoopsInAMapByPath) {
  const TempDir dir;
  std::vector<std::string> messages;
  const auto session = [&](const std::string& drive, std::optional<bool> verify, bool keep_clouds) {
    LoopDetector detector({.map = dir / "site.map",
                           .drive = drive,
                           .verify = verify,
                           .keep_clouds = keep_clouds,
                           .warn = into(messages)});
    EXPECT_TRUE(detector.verifies());
    EXPECT_EQ(detector.threshold(), verified_calibration().threshold_for(0.99));
    return take(detector, 1, {});
  };
  EXPECT_FALSE(session("monday", {}, true).loop);
  // With the points of monday.
  for (const auto& [drive, verify, keep] :
       {std::tuple("tuesday", std::optional<bool>(), true), {"wednesday", true, false}}) {
    const Detection found = session(drive, verify, keep);
    ASSERT_TRUE(found.accepted) << found.rejection << found.error;
    EXPECT_EQ(found.loop->drive, "monday");
    EXPECT_TRUE(found.registered->T_place_query.isApprox(Eigen::Isometry3d::Identity(), 0.01));
  }
  EXPECT_EQ(session("wednesday", true, false).index, 2) << "the same scan: resumed";
  ASSERT_EQ(messages.size(), 1);
  EXPECT_HAS(messages[0], "sensor: ");
}

TEST(LoopDetector, ExcludesOverlappingLocalMaps) {
  OnMap on({.exclusion = kNone}, {.local_map = 20});
  for (int x = 0; x <= 60; x += 4) {
    const Detection found = take(on.detector, x, stamp_at(x, x));
    EXPECT_EQ(found.loop.has_value(), x > 20) << x;
    EXPECT_LT(found.loop.value_or(Loop{.frame = -99}).frame, x - 20);
  }
}

/// Must be equal to what the drives yield (verified_calibration.py).
TEST(VerifiedCalibration, ReachesThePrecisionOf99Percent) {
  const Calibration& calibration = verified_calibration();
  ASSERT_TRUE(calibration.threshold_for(0.99));
  EXPECT_EQ(calibration.threshold_for(0.99), 0);
  EXPECT_LT(calibration.probability(-0.4), 0.001);
  EXPECT_LT(calibration.probability(-0.2), 0.05);
  EXPECT_GT(calibration.probability(0.1), 0.99);
}

TEST(LoopDetector, AccumulatesTheLastMeters) {
  LocalMap walls(20);
  PointsView seen;
  Eigen::Isometry3d here;
  for (int x = 0; x <= 40; x += 2) {
    PointCloud ahead;
    for (float y = -5; y <= 5; y += 0.5F) ahead.points.push_back({2, y, 1, 0});
    here = Eigen::Translation3d(x, 3, 0) * Eigen::AngleAxisd(0.01 * x, Eigen::Vector3d::UnitZ());
    seen = walls.add(view_of(ahead), here);
  }
  PointCloud cloud;
  copy_points(seen, cloud);
  EXPECT_EQ(cloud.points.size(), 11 * 21) << "voxels are smaller than the steps";
  std::vector<double> middle;  // of the walls
  for (const Point& p : cloud.points) {
    const Eigen::Vector3d at = here * Eigen::Vector3d(p.x, p.y, p.z);
    if (std::abs(at.y() - 3) <= 0.6) middle.push_back(at.x());
  }
  EXPECT_NEAR(std::ranges::min(middle), 22, 0.3);
  EXPECT_NEAR(std::ranges::max(middle), 42, 0.6);

  OnMap on({}, {.local_map = 20});
  PointCloud one;
  one.points.push_back({20, 0, 0, 0});
  for (const int x : {0, 1}) {
    const Detection found = on.detector.take(view_of(one), stamp_at(x, x));
    EXPECT_EQ(found.error, x == 0 ? "fewer than two points" : "");
    EXPECT_EQ(on.map.size(), x);
    EXPECT_FALSE(found.loop || found.index.has_value() != (x == 1));
  }
}

TEST(LoopDetector, SubtractsOldScansExactly) {
  static constexpr double kFar = 4e6;  // [m], as UTM's northing
  const auto seen = [](LocalMap& map, double x) {
    PointCloud scan, cloud;
    for (int i = 0; i < 40; ++i)
      scan.points.push_back({0.37F * static_cast<float>(i), std::sin(static_cast<float>(i)), 1, 0});
    copy_points(map.add(view_of(scan), Eigen::Isometry3d(Eigen::Translation3d(x, kFar, 0))), cloud);
    std::vector<std::array<long, 3>> points;  // rounded, so that the last bits do not matter
    const auto rounded = [](float v) { return std::lround(4096.0 * double{v} + 0.05); };
    for (const Point& p : cloud.points)
      points.push_back({rounded(p.x), rounded(p.y), rounded(p.z)});
    std::ranges::sort(points);
    return points;
  };
  LocalMap driven(20), halted(20), late(20);
  for (int x = 0; x < 100; x += 4) {
    seen(driven, x);
    for (const double halt : {0.0, 0.2, 0.0}) seen(halted, x + halt);
    if (x >= 80) seen(late, x);
  }
  const auto expected = seen(late, 100);
  EXPECT_EQ(seen(driven, 100), expected);
  EXPECT_EQ(seen(halted, 100), expected);
  for (const double away : {1e6, 1e18, 1e200}) {
    LocalMap jumped(20);
    for (const double x : {76.0, away, 80.0, 84.0, 88.0, 92.0, 96.0}) seen(jumped, x);
    EXPECT_EQ(seen(jumped, 100), expected) << away;
  }
  const Eigen::Isometry3d nowhere(Eigen::Translation3d(NAN, 0, 0));
  expect_error<UsageError>([&] { late.add({}, nowhere); }, {"not finite"});
}

/// Drive and matches.
using Resumed = std::pair<std::string, std::vector<int64_t>>;

/// Takes scans `first` to `last` of a recording by a new detector. `clock` [s]: its start.
Resumed resume(Map& map, int first, int last, double start, const char* exclusion = "none",
               std::optional<double> clock = {}) {
  LoopDetector detector(map, {.drive = "monday", .exclusion = parse_exclusion(exclusion)});
  Resumed result;
  for (int frame = first; frame < last; ++frame) {
    ScanStamp stamp{.frame = frame};
    if (clock) stamp.time = *clock + 0.1 * frame;
    result.second.push_back(match_of(detector, start + 0.2 * frame, stamp));
  }
  result.first = detector.drive();
  return result;
}

TEST(LoopDetector, ResumesRecordingsByContent) {
  Map map(first_point(), {});
  const auto drive = [&](int last, double start) {
    return resume(map, 0, last, start, "frames=1");
  };
  EXPECT_EQ(drive(6, 0), (Resumed{"monday", {-1, -1, 0, 1, 2, 3}})) << "then it is killed";
  EXPECT_EQ(map.size(), 6);
  EXPECT_EQ(drive(8, 0), (Resumed{"monday", {-1, -1, 0, 1, 2, 3, 4, 5}}));
  EXPECT_EQ(map.size(), 8);
  // Entries 0 to 7 are of another recording: its first scan may match any of them.
  EXPECT_EQ(drive(2, 1).first, "monday-2");
  EXPECT_EQ(map.size(), 10);
  EXPECT_EQ(drive(2, 1), (Resumed{"monday-2", {5, 6}}));
  EXPECT_EQ(map.size(), 10);
}

/// Its first scan has no preceding motion, so it differs a little from the one in the map.
TEST(LoopDetector, ResumesADeskewedRecording) {
  Map map(first_point(), {});
  const auto drive = [&](int first, double start, double clock) {
    return resume(map, first, 6, start, "none", clock).first;
  };
  EXPECT_EQ(drive(0, 0, 1.7e9), "monday");
  EXPECT_EQ(drive(2, 0.1, 1.7e9), "monday") << "its similarity is 0.995";
  EXPECT_EQ(drive(2, 0.1, 1.8e9), "monday-2");
}

/// The first entry was removed, or its folder had fewer scans the first time.
TEST(LoopDetector, ResumesWithoutTheFirstEntry) {
  Map map(first_point(), {});
  resume(map, 3, 7, 0);
  EXPECT_EQ(resume(map, 0, 7, 0).first, "monday");
  EXPECT_EQ(map.size(), 7);
  map.remove(std::vector<int64_t>{5, 6});
  EXPECT_EQ(resume(map, 0, 7, 0).first, "monday");
  EXPECT_EQ(map.size(), 9) << "what was removed is added again";
}

TEST(LoopDetector, ResumesRecordingsOfMergedMaps) {
  Map map(first_point(), {});
  for (const auto& [name, angle] : {std::pair("monday", 1.0), std::pair("robot/monday", 2.0)})
    add_scan(map, map.describe(view_of(room(angle))), {.drive = name});
  EXPECT_EQ(resume(map, 0, 1, 2, "frames=9"), (Resumed{"robot/monday", {0}}));
  EXPECT_EQ(map.size(), 2);
}

TEST(LoopDetector, AddsOneScanOfAFirstHalt) {
  FeatureExtractor extractor = first_point(0.9);
  extractor.fit_projection = [same = extractor.comparison](auto&&...) {
    const auto copy = [](std::span<const float> feature, std::span<float> descriptor) {
      std::ranges::copy(feature, descriptor.begin());
    };
    return Projection{.dim = 3, .describe = copy, .comparison = same};
  };
  OnMap on({}, {.warmup = 3}, extractor);
  auto next = [&, frame = int64_t{0}](double angle) mutable {
    return take(on.detector, angle, {.frame = frame++});
  };
  for (int i = 0; i < 30; ++i) EXPECT_EQ(next(0).index.has_value(), i == 0);
  EXPECT_FALSE(on.map.is_warmed_up());
  for (const double angle : {1, 2}) EXPECT_TRUE(next(angle).index);
  EXPECT_TRUE(on.map.is_warmed_up());
  EXPECT_TRUE(next(2).index) << "now halts are stored";
}

TEST(LoopDetector, FramesAscendAndPointsAreInMeters) {
  OnMap on({.exclusion = kNone});
  take(on.detector, 2, {.frame = 7});
  for (const int64_t frame : {7, 6, -1})
    expect_error<UsageError>([&] { take(on.detector, 2, {.frame = frame}); },
                             {str("frame ", frame), "ascend", "after 7"});
  PointCloud millimeters = room(2);
  for (Point& p : millimeters.points) p = {1000 * p.x, 1000 * p.y, 1000 * p.z};
  const Detection found = on.detector.take(view_of(millimeters), {.frame = 8});
  EXPECT_HAS(found.error, "millimeters");
  EXPECT_FALSE(found.index);
}

TEST(LoopDetector, RejectsEntriesWithoutPoints) {
  OnMap on({.exclusion = kNone, .verify = true, .keep_clouds = false});
  EXPECT_EQ(take(on.detector, 2).rejection, "");
  const Detection found = take(on.detector, 2, {.frame = 1});
  EXPECT_TRUE(found.loop && !found.accepted);
  EXPECT_EQ(found.rejection, "no points");
}

TEST(LoopDetector, TransformsResultsToSensorFrames) {
  const Eigen::Isometry3d mount = parse_mount("180,0,20,0.2,0,0.5");
  OnMap on({.exclusion = kNone, .verify = true}, {.mount = mount}), mounted;
  // A sensor upside down sees the room, then again 0.5 m further on.
  const Eigen::Isometry3d moved(Eigen::Translation3d(0.5, 0.2, 0));
  PointCloud entry = room(2), query = entry;
  transform(mount.inverse(), entry);
  transform(mount.inverse() * moved.inverse(), query);
  on.detector.take(view_of(entry), next_stamp());
  const Detection found = on.detector.take(view_of(query), next_stamp());
  ASSERT_TRUE(found.registered);
  EXPECT_TRUE(found.registered->fits) << found.registered->inlier_ratio;
  const Eigen::Isometry3d expected = mount.inverse() * moved * mount;
  EXPECT_TRUE(found.registered->T_place_query.isApprox(expected, 0.02));
  // A small motion of the query has the same information as with mounted points.
  transform(mount, entry);
  transform(mount, query);
  mounted.detector.take(view_of(entry), next_stamp());
  const Detection same = mounted.detector.take(view_of(query), next_stamp());
  ASSERT_TRUE(same.registered);
  const auto square = [](const Detection& of, const Eigen::Isometry3d& moves) {
    const Eigen::AngleAxisd turn(moves.rotation());
    Eigen::Matrix<double, 6, 1> motion;
    motion << moves.translation(), turn.angle() * turn.axis();
    return motion.dot(of.registered->information * motion);
  };
  for (int i = 0; i < 6; ++i) {  // translations along and rotations about the axes
    const Eigen::Vector3d axis = Eigen::Vector3d::Unit(i % 3);
    Eigen::Isometry3d moves(Eigen::Translation3d((i < 3 ? 1e-5 : 0) * axis));
    moves.rotate(Eigen::AngleAxisd(i < 3 ? 0 : 1e-5, axis));
    EXPECT_NEAR(square(found, moves) / square(same, mount * moves * mount.inverse()), 1, 0.02) << i;
  }
}

TEST(LoopDetector, StoresKeyframesAndQueriesAllScans) {
  for (const char* rule : {"meters=3", "similarity=0.9"}) {
    OnMap on({.exclusion = parse_exclusion("frames=3"), .keyframes = rule});
    std::vector<int64_t> stored;
    for (int frame = 0; frame < 9; ++frame) {  // 1 m and 0.2 rad each: cos(0.6) is 0.83
      const Detection found = take(on.detector, 0.2 * frame, stamp_at(frame, frame));
      if (found.index) stored.push_back(frame);
      EXPECT_EQ(found.loop.has_value(), frame > 3) << rule << frame;
    }
    EXPECT_EQ(stored, (std::vector<int64_t>{0, 3, 6})) << rule;
  }
  for (const char* wrong : {"", "meters", "meters=0", "similarity=1.5", "frames=3", "meters=x"})
    expect_error<UsageError>([&] { check_keyframes(wrong); }, {"keyframes"});
  OnMap on({.keyframes = "meters=1"});
  expect_error<UsageError>([&] { take(on.detector, 1); }, {"similarity=S"});
}

}  // namespace
}  // namespace revisit
