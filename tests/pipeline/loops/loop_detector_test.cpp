#include "revisit/loops/loop_detector.h"

#include "local_map.h"
#include "revisit/loops/loop_outputs.h"
#include "revisit/recognition/align.h"
#include "testing.h"

namespace revisit {
namespace {

/// Scans of one entry have equal first points.
FeatureExtractor first_point() {
  FeatureExtractor extractor;
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

int64_t match_of(LoopDetector& detector, double angle, const ScanStamp& stamp) {
  const PointCloud cloud = room(angle);
  const Detection found = detector.take(view_of(cloud), stamp);
  EXPECT_TRUE(found.index) << found.error;
  return found.loop ? found.loop->index : -1;
}

TEST(LoopDetector, ExcludesRecentScans) {
  const auto stamp = [](int64_t frame) {
    ScanStamp scan{.frame = frame, .time = 0.5 * static_cast<double>(frame)};
    scan.pose.emplace(Eigen::Translation3d(2.0 * static_cast<double>(frame), 0, 0));
    return scan;
  };
  // Loops are more than two frames, one second or four meters apart.
  for (const char* exclusion : {"frames=2", "seconds=1", "meters=4"}) {
    PlaceRecognizer recognizer(first_point(), {});
    LoopDetector detector(recognizer, {.exclusion = parse_exclusion(exclusion)});
    for (int64_t frame = 0; frame < 3; ++frame)
      EXPECT_EQ(match_of(detector, 0.1 * static_cast<double>(frame), stamp(frame)), -1);
    EXPECT_EQ(match_of(detector, 0.3, stamp(3)), 0) << exclusion;
    EXPECT_EQ(match_of(detector, 0.1, stamp(4)), 1) << exclusion;
    if (!std::string(exclusion).starts_with("frames"))
      expect_error<UsageError>([&] { detector.take({}, {.frame = 5}); }, {"use frames=N"});
  }
  PlaceRecognizer recognizer(first_point(), {});
  LoopDetector detector(recognizer, {.exclusion = parse_exclusion("none")});
  EXPECT_EQ(match_of(detector, 0.1, {.frame = 0}), -1);
  EXPECT_EQ(match_of(detector, 0.1, {.frame = 1}), 0);
}

TEST(LoopDetector, StoresNoScanWithoutDescription) {
  PlaceRecognizer recognizer(first_point(), {});
  LoopDetector detector(recognizer, {});
  PointCloud one;
  one.points.push_back({1, 2, 3, 0});
  const Detection found = detector.take(view_of(one), {});
  EXPECT_FALSE(found.index);
  EXPECT_FALSE(found.loop);
  EXPECT_EQ(found.error, "fewer than two points");
  EXPECT_EQ(recognizer.size(), 0);
}

TEST(LoopDetector, ExcludesTheHaltOfAScan) {
  FeatureExtractor extractor = first_point();
  extractor.comparison.same_place = 0.9;
  PlaceRecognizer recognizer(extractor, {});
  LoopDetector detector(recognizer, {.exclusion = parse_exclusion("frames=3")});
  int64_t frame = 0;
  const auto match = [&](double angle) { return match_of(detector, angle, {.frame = frame++}); };
  EXPECT_EQ(match(2), -1);
  for (int i = 0; i < 20; ++i) EXPECT_LE(match(0), 0) << "only the entry before the halt";
  for (int i = 0; i < 5; ++i) match(3);
  EXPECT_GE(match(0.01), 1) << "back at the halt";
}

TEST(LoopDetector, RegistersSimilarEntriesOnly) {
  PlaceRecognizer recognizer(first_point(), {});
  for (const auto& [threshold, rejection] : {std::pair(0.1, "similarity"), {0.5, "score"}}) {
    LoopDetector detector(recognizer,
                          {.exclusion = parse_exclusion("none"), .threshold = threshold});
    match_of(detector, 0, {});
    const PointCloud cloud = room(1.3);  // its similarity is 0.27
    const Detection found = detector.take(view_of(cloud), {});
    EXPECT_FALSE(found.registered);
    EXPECT_EQ(found.rejection, rejection);
    recognizer.remove(std::vector<int64_t>{*found.index});
  }
}

TEST(LoopDetector, RegistersSimilarEntries) {
  PlaceRecognizer recognizer(first_point(), {});
  const LoopDetectorOptions options{
      .drive = "monday", .exclusion = parse_exclusion("none"), .verify = true};
  LoopDetector detector(recognizer, options);
  for (const double angle : {0.0, 2.0, 4.0, 5.0}) match_of(detector, angle, {});
  const PointCloud cloud = room(2);
  const Detection found = detector.take(view_of(cloud), {});
  ASSERT_TRUE(found.loop && found.registered);
  EXPECT_EQ(found.loop->index, 1);
  EXPECT_EQ(found.loop->drive, "monday");
  EXPECT_TRUE(found.registered->accepted);
  EXPECT_TRUE(found.loop->accepted);
  EXPECT_EQ(found.rejection, "");
  // Points are kept in steps of 1/32 m.
  EXPECT_TRUE(found.registered->T_place_query.isApprox(Eigen::Isometry3d::Identity(), 0.01));

  PointCloud other = room(2);  // looks alike, but its walls are elsewhere
  for (size_t i = 1; i < other.points.size(); ++i) other.points[i].x *= 2.5F;
  const Detection rejected = detector.take(view_of(other), {});
  ASSERT_TRUE(rejected.loop && rejected.registered);
  EXPECT_FALSE(rejected.registered->accepted);
  EXPECT_FALSE(rejected.loop->accepted);
  EXPECT_EQ(rejected.rejection, "registration");
}

/// Another room is the most similar to the query; the room itself is a little less similar.
TEST(LoopDetector, ChoosesTheEntryThatFits) {
  PlaceRecognizer recognizer(first_point(), {});
  LoopDetector detector(recognizer, {.exclusion = parse_exclusion("none"), .threshold = 1.2});
  const auto take = [&](double angle, double stretch) {
    PointCloud cloud = room(angle);
    for (size_t i = 1; i < cloud.points.size(); ++i)
      cloud.points[i].x *= static_cast<float>(stretch);
    return detector.take(view_of(cloud), {});
  };
  take(2, 2.5);
  EXPECT_FALSE(take(4, 1).registered) << "its similarity is -0.4";
  take(2.3, 1);
  const Detection found = take(2.1, 1);
  ASSERT_TRUE(found.loop && found.registered);
  EXPECT_EQ(found.loop->index, 2);
  EXPECT_TRUE(found.loop->accepted);
  EXPECT_NEAR(found.loop->similarity, std::cos(0.2), 1e-6);
  EXPECT_EQ(found.loop->score, found.loop->similarity + found.registered->inlier_ratio);
  EXPECT_EQ(found.loop->probability, verified_calibration().probability(found.loop->score));
}

/// More points fit along two walls than at a corner, but the scans are unconstrained.
TEST(LoopDetector, PrefersAcceptedRegistrations) {
  for (const double corner_at : {1.0, 1.1}) {  // more similar than the walls, and less
    SCOPED_TRACE(corner_at);
    PlaceRecognizer recognizer(first_point(), {});
    LoopDetector detector(recognizer, {.exclusion = parse_exclusion("none"), .threshold = 0.8});
    const auto take = [&](double angle, const auto& is_seen) {
      PointCloud cloud = room(angle);
      std::erase_if(cloud.points, [&](const Point& p) {
        const bool floor = std::abs(p.x) < 9.9F && std::abs(p.y) < 7.9F;
        return !floor && !is_seen(p);
      });
      cloud.points.insert(cloud.points.begin(), room(angle).points[0]);
      return detector.take(view_of(cloud), {});
    };
    take(corner_at, [](const Point& p) { return p.x > 9.9F || (p.y > 7.9F && p.x > -4); });
    take(-1.05, [](const Point& p) { return std::abs(p.x) < 9.9F; });
    const Detection found = take(0, [](const Point&) { return true; });
    ASSERT_TRUE(found.loop && found.registered);
    EXPECT_EQ(found.loop->index, 0);
    EXPECT_TRUE(found.loop->accepted);
  }
}

TEST(LoopDetector, AcceptsRegisteredLoopsByTheirCalibration) {
  const TempDir dir;
  const MapFingerprint fingerprint = PlaceRecognizer::fingerprint_of(first_point(), {});
  const auto recognizer = [&] {
    return PlaceRecognizer(first_point(), {.threshold = 7},
                           open_map(dir / "map", MapAccess::kWrite, &fingerprint));
  };
  {
    PlaceRecognizer first = recognizer();
    const LoopDetector detector(first, {});
    EXPECT_EQ(detector.score(), Score::kVerified);
    EXPECT_EQ(detector.calibration(), verified_calibration());
    EXPECT_EQ(detector.threshold(), verified_calibration().threshold_for(0.99));
    EXPECT_EQ(LoopDetector(first, {.threshold = 0.8}).threshold(), 0.8);
    EXPECT_FALSE(LoopDetector(first, {.target_precision = 0.99999}).threshold());
    expect_error<UsageError>([&] { LoopDetector(first, {.target_precision = 2}); }, {"precision"});
    expect_error<UsageError>([&] { LoopDetector(first, {.threshold = NAN}); }, {"threshold"});
    EXPECT_EQ(LoopDetector(first, {.verify = false}).threshold(), 7);
    Calibration own = verified_calibration();
    own.trained_on = "a town";
    own.blocks = {{0.2, 1000, 0}, {1.3, 1000, 1000}};
    first.calibrate(own);
  }
  {
    PlaceRecognizer again = recognizer();
    EXPECT_EQ(LoopDetector(again, {}).threshold(), 1.3) << "kept in the map";
    EXPECT_EQ(again.threshold(), 7) << "of what is not registered";
  }
  Calibration other = verified_calibration();
  other.score = Score::kMargin;
  open_map(dir / "map", MapAccess::kWrite)
      ->set_value(kVerifiedCalibrationValue, calibration_content(other));
  PlaceRecognizer odd = recognizer();
  EXPECT_EQ(LoopDetector(odd, {}).calibration(), verified_calibration()) << "left aside";
}

/// Its first scan has no preceding motion, so it differs a little from the one in the map.
TEST(LoopDetector, ResumesADeskewedRecording) {
  PlaceRecognizer recognizer(first_point(), {});
  const auto drive = [&](int first, double start, double clock) {
    LoopDetector detector(recognizer, {.drive = "monday", .exclusion = parse_exclusion("none")});
    for (int frame = first; frame < 6; ++frame)
      match_of(detector, start + 0.2 * frame, {.frame = frame, .time = clock + 0.1 * frame});
    return detector.drive();
  };
  EXPECT_EQ(drive(0, 0, 1.7e9), "monday");
  EXPECT_EQ(drive(2, 0.1, 1.7e9), "monday") << "its similarity is 0.995";
  EXPECT_EQ(drive(2, 0.1, 1.8e9), "monday-2");
}

TEST(LoopDetector, ExcludesOverlappingLocalMaps) {
  PlaceRecognizer recognizer(first_point(), {});
  LoopDetector detector(recognizer, {.exclusion = parse_exclusion("none"), .local_map = 20});
  for (int x = 0; x <= 60; x += 4) {
    const PointCloud cloud = room(x);
    ScanStamp stamp{.frame = x};
    stamp.pose.emplace(Eigen::Translation3d(x, 0, 0));
    const Detection found = detector.take(view_of(cloud), stamp);
    EXPECT_EQ(found.loop.has_value(), x > 20) << x;
    if (found.loop) {
      EXPECT_LT(found.loop->frame, x - 20);
    }
  }
}

TEST(LoopDetector, RejectsMapsOfOtherLocalMaps) {
  const TempDir dir;
  const RecognizerOptions options{.local_map = 10};
  const MapFingerprint fingerprint = PlaceRecognizer::fingerprint_of(first_point(), options);
  PlaceRecognizer recognizer(first_point(), options,
                             open_map(dir / "map", MapAccess::kWrite, &fingerprint));
  LoopDetector(recognizer, {.local_map = 10});
  expect_error<UsageError>([&] { LoopDetector(recognizer, {}); }, {"local map", "10 m"});
  expect_error<InputError>(
      [&] { PlaceRecognizer(first_point(), {}, open_map(dir / "map", MapAccess::kRead)); },
      {"local map: the map has '10 m', this program none"});
}

/// Must be equal to what the drives yield (verified_calibration.py).
TEST(VerifiedCalibration, ReachesThePrecisionOf99Percent) {
  const Calibration& calibration = verified_calibration();
  EXPECT_EQ(parse_calibration(calibration_content(calibration), "it"), calibration);
  ASSERT_TRUE(calibration.threshold_for(0.99));
  EXPECT_GT(*calibration.threshold_for(0.99), 0.8) << "a wrong match of NCLT has 0.79";
  EXPECT_LT(*calibration.threshold_for(0.99), 1);
  EXPECT_LT(calibration.probability(0.4), 0.02);
  EXPECT_GT(calibration.probability(1.3), 0.99);
}

TEST(LoopDetector, AccumulatesTheLastMeters) {
  LocalMap map(20);
  PointsView seen;
  for (int x = 0; x <= 40; x += 2) {
    PointCloud ahead;
    for (float y = -5; y <= 5; y += 0.5F) ahead.points.push_back({2, y, 1, 0});
    const Eigen::Isometry3d pose(Eigen::Translation3d(x, 3, 0) *
                                 Eigen::AngleAxisd(0.01 * x, Eigen::Vector3d::UnitZ()));
    seen = map.add(view_of(ahead), pose);
  }
  PointCloud cloud;
  copy_points(seen, cloud);
  EXPECT_EQ(cloud.points.size(), 11 * 21) << "voxels are smaller than the steps";
  const Eigen::Isometry3d here(Eigen::Translation3d(40, 3, 0) *
                               Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitZ()));
  double first = 100, last = 0;
  for (const Point& p : cloud.points) {
    const Eigen::Vector3d at = here * Eigen::Vector3d(p.x, p.y, p.z);
    if (std::abs(at.y() - 3) > 0.6) continue;  // near the middle of the walls
    first = std::min(first, at.x());
    last = std::max(last, at.x());
  }
  EXPECT_NEAR(first, 22, 0.3);
  EXPECT_NEAR(last, 42, 0.6);

  PlaceRecognizer recognizer(first_point(), {});
  expect_error<UsageError>([&] { LoopDetector(recognizer, {.local_map = 500}); }, {"1 to 200 m"});
  LoopDetector detector(recognizer, {.local_map = 20});
  EXPECT_HAS(detector.take(view_of(cloud), {.frame = 5}).error, "scan 5 has no pose");
  PointCloud one;
  one.points.push_back({20, 0, 0, 0});
  for (const int x : {0, 1}) {
    ScanStamp stamp{.frame = x};
    stamp.pose.emplace(Eigen::Translation3d(x, 0, 0));
    EXPECT_EQ(detector.take(view_of(one), stamp).error, x == 0 ? "fewer than two points" : "");
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

TEST(LoopDetector, ResumesRecordingsByContent) {
  PlaceRecognizer recognizer(first_point(), {});
  const auto drive = [&](int first, int last, double start) {
    LoopDetector detector(recognizer,
                          {.drive = "monday", .exclusion = parse_exclusion("frames=1")});
    std::vector<int64_t> matches;
    for (int frame = first; frame < last; ++frame)
      matches.push_back(match_of(detector, start + 0.2 * frame, {.frame = frame}));
    return std::pair(detector.drive(), matches);
  };
  const auto killed = drive(0, 6, 0);
  EXPECT_EQ(killed, std::pair(std::string("monday"), (std::vector<int64_t>{-1, -1, 0, 1, 2, 3})));
  EXPECT_EQ(recognizer.size(), 6);
  const auto again = drive(0, 8, 0);  // as without the kill
  EXPECT_EQ(again,
            std::pair(std::string("monday"), (std::vector<int64_t>{-1, -1, 0, 1, 2, 3, 4, 5})));
  EXPECT_EQ(recognizer.size(), 8);
  // Entries 0 to 7 are of another recording: its first scan may match any of them.
  EXPECT_EQ(drive(0, 2, 1).first, "monday-2");
  EXPECT_EQ(recognizer.size(), 10);
  EXPECT_EQ(drive(0, 2, 1), std::pair(std::string("monday-2"), (std::vector<int64_t>{5, 6})));
  EXPECT_EQ(recognizer.size(), 10);
}

/// The first entry was removed, or its folder had fewer scans the first time.
TEST(LoopDetector, ResumesWithoutTheFirstEntry) {
  PlaceRecognizer recognizer(first_point(), {});
  const auto drive = [&](int first, int last, double start) {
    LoopDetector detector(recognizer, {.drive = "monday", .exclusion = parse_exclusion("none")});
    for (int frame = first; frame < last; ++frame)
      match_of(detector, start + 0.2 * frame, {.frame = frame});
    return detector.drive();
  };
  drive(3, 7, 0);
  EXPECT_EQ(drive(0, 7, 0), "monday");
  EXPECT_EQ(recognizer.size(), 7);
  recognizer.remove(std::vector<int64_t>{5, 6});
  EXPECT_EQ(drive(0, 7, 0), "monday");
  EXPECT_EQ(recognizer.size(), 9) << "what was removed is added again";
}

TEST(LoopDetector, ResumesRecordingsOfMergedMaps) {
  PlaceRecognizer recognizer(first_point(), {});
  for (const auto& [name, angle] : {std::pair("monday", 1.0), std::pair("robot/monday", 2.0)}) {
    const PointCloud cloud = room(angle);
    recognizer.add(recognizer.describe(view_of(cloud)), {.drive = name});
  }
  LoopDetector detector(recognizer, {.drive = "monday", .exclusion = parse_exclusion("frames=9")});
  EXPECT_EQ(match_of(detector, 2, {}), 0);
  EXPECT_EQ(detector.drive(), "robot/monday");
  EXPECT_EQ(recognizer.size(), 2);
}

TEST(LoopDetector, AddsOneScanOfAFirstHalt) {
  FeatureExtractor extractor = first_point();
  extractor.comparison.same_place = 0.9;
  extractor.fit_projection = [comparison = extractor.comparison](const Rows&,
                                                                 std::span<const int64_t>) {
    Projection projection;
    projection.dim = 3;
    projection.describe = [](std::span<const float> feature, std::span<float> descriptor) {
      std::ranges::copy(feature, descriptor.begin());
    };
    projection.comparison = comparison;
    return projection;
  };
  PlaceRecognizer recognizer(extractor, {.warmup = 3});
  LoopDetector detector(recognizer, {});
  auto take = [&, frame = int64_t{0}](double angle) mutable {
    const PointCloud cloud = room(angle);
    return detector.take(view_of(cloud), {.frame = frame++});
  };
  for (int i = 0; i < 30; ++i) EXPECT_EQ(take(0).index.has_value(), i == 0);
  EXPECT_FALSE(recognizer.is_warmed_up());
  for (const double angle : {1, 2}) EXPECT_TRUE(take(angle).index);
  EXPECT_TRUE(recognizer.is_warmed_up());
  EXPECT_TRUE(take(2).index) << "now halts are stored";
}

TEST(LoopDetector, RegistersEntriesOfEarlierSessions) {
  const TempDir dir;
  const auto session = [&](const std::string& drive, bool keep_clouds) {
    const MapFingerprint fingerprint = PlaceRecognizer::fingerprint_of(first_point(), {});
    PlaceRecognizer recognizer(first_point(), {},
                               open_map(dir / "map", MapAccess::kWrite, &fingerprint));
    LoopDetector detector(recognizer, {.drive = drive,
                                       .exclusion = parse_exclusion("frames=10"),
                                       .verify = true,
                                       .keep_clouds = keep_clouds});
    const PointCloud cloud = room(drive == "wednesday" ? 0.7 : 2);
    return detector.take(view_of(cloud), {});
  };
  EXPECT_FALSE(session("monday", true).loop);
  const Detection tuesday = session("tuesday", false);
  ASSERT_TRUE(tuesday.registered);
  EXPECT_TRUE(tuesday.loop->accepted);
  EXPECT_TRUE(tuesday.registered->T_place_query.isApprox(Eigen::Isometry3d::Identity(), 0.01));
  session("wednesday", false);
  const Detection without = session("wednesday", false);  // the same scan: resumed
  EXPECT_EQ(without.index, 2);
}

TEST(LoopDetector, RejectsEntriesWithoutPoints) {
  PlaceRecognizer recognizer(first_point(), {});
  LoopDetector detector(
      recognizer, {.exclusion = parse_exclusion("none"), .verify = true, .keep_clouds = false});
  const PointCloud cloud = room(2);
  EXPECT_EQ(detector.take(view_of(cloud), {}).rejection, "");
  const Detection found = detector.take(view_of(cloud), {.frame = 1});
  ASSERT_TRUE(found.loop);
  EXPECT_FALSE(found.loop->accepted);
  EXPECT_EQ(found.rejection, "no points");
}

TEST(LoopDetector, TransformsResultsToSensorFrames) {
  const Eigen::Isometry3d mount = parse_mount("180,0,20,0.2,0,0.5");
  PlaceRecognizer recognizer(first_point(), {.mount = mount});
  LoopDetector detector(recognizer, {.exclusion = parse_exclusion("none"), .verify = true});
  // A sensor upside down sees the room, then again 0.5 m further on.
  const Eigen::Isometry3d moved(Eigen::Translation3d(0.5, 0.2, 0));
  PointCloud entry = room(2), query = entry;
  transform(mount.inverse(), entry);
  transform(mount.inverse() * moved.inverse(), query);
  detector.take(view_of(entry), {});
  const Detection found = detector.take(view_of(query), {});
  ASSERT_TRUE(found.registered);
  EXPECT_TRUE(found.registered->accepted) << found.registered->inlier_ratio;
  const Eigen::Isometry3d expected = mount.inverse() * moved * mount;
  EXPECT_TRUE(found.registered->T_place_query.isApprox(expected, 0.02));
  // A small motion of the query has the same information as with mounted points.
  transform(mount, entry);
  transform(mount, query);
  PlaceRecognizer mounted(first_point(), {});
  LoopDetector plain(mounted, {.exclusion = parse_exclusion("none"), .verify = true});
  plain.take(view_of(entry), {});
  const Detection same = plain.take(view_of(query), {});
  ASSERT_TRUE(same.registered);
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  for (int i = 0; i < 6; ++i) {  // translations along and rotations about the axes
    const Vector6 motion = 1e-5 * Vector6::Unit(i);
    Eigen::Isometry3d moves(Eigen::Translation3d(motion.head<3>()));
    if (i >= 3) moves.linear() = Eigen::AngleAxisd(1e-5, motion.tail<3>() * 1e5).matrix();
    const Eigen::Isometry3d moves_mounted = mount * moves * mount.inverse();
    const Eigen::AngleAxisd turn(moves_mounted.rotation());
    Vector6 motion_mounted;
    motion_mounted << moves_mounted.translation(), turn.angle() * turn.axis();
    const double expected_square =
        motion_mounted.dot(same.registered->information * motion_mounted);
    const double square = motion.dot(found.registered->information * motion);
    EXPECT_NEAR(square / expected_square, 1, 0.02) << i;
  }
}

TEST(LoopDetector, StoresKeyframesAndQueriesAllScans) {
  for (const char* rule : {"meters=3", "similarity=0.9"}) {
    PlaceRecognizer recognizer(first_point(), {});
    LoopDetector detector(recognizer,
                          {.exclusion = parse_exclusion("frames=3"), .keyframes = rule});
    std::vector<int64_t> stored;
    for (int frame = 0; frame < 9; ++frame) {  // 1 m and 0.2 rad each: cos(0.6) is 0.83
      const PointCloud cloud = room(0.2 * frame);
      const Detection found = detector.take(
          view_of(cloud),
          {.frame = frame, .pose = Eigen::Isometry3d(Eigen::Translation3d(frame, 0, 0))});
      if (found.index) stored.push_back(frame);
      EXPECT_EQ(found.loop.has_value(), frame > 3) << rule << frame;
    }
    EXPECT_EQ(stored, (std::vector<int64_t>{0, 3, 6})) << rule;
  }
  for (const char* wrong : {"", "meters", "meters=0", "similarity=1.5", "frames=3", "meters=x"})
    expect_error<UsageError>([&] { check_keyframes(wrong); }, {"keyframes"});
  PlaceRecognizer recognizer(first_point(), {});
  LoopDetector detector(recognizer, {.keyframes = "meters=1"});
  const PointCloud cloud = room(1);
  expect_error<UsageError>([&] { detector.take(view_of(cloud), {}); }, {"similarity=S"});
}

TEST(LoopSummary, CountsRejections) {
  LoopSummary summary(parse_exclusion("frames=5"), 0.6);
  EXPECT_EQ(summary.text(),
            "0 scans, 0 loops accepted: no scan had a candidate (exclusion frames=5)");
  const auto add = [&](double score, const std::string& rejection) {
    Detection found{.loop = Loop{}, .rejection = rejection};
    found.loop->score = score;
    found.loop->accepted = rejection.empty();
    summary.add(found);
  };
  summary.add({});
  add(0.4, "score");
  EXPECT_EQ(summary.text(),
            "2 scans, 0 loops accepted: the best score of 1 query is 0.4 (threshold 0.6); 1 scan "
            "had no candidate (exclusion frames=5)");
  add(0.7, "score");
  add(0.7, "similarity");
  add(0.8, "ambiguous");
  add(0.8, "registration");
  add(0.8, "no points");
  add(0.9, "");
  summary.add({.error = "the scan has no points"});
  EXPECT_EQ(summary.text(),
            "9 scans, 1 loop accepted, 1 more look alike, among too few distinct entries, 1 more "
            "look alike, but not enough to be registered, 1 more look alike, where the drive looks "
            "alike for long, 1 more look alike, but their points "
            "do not fit, 1 more look alike, but their entries were stored without points, 1 scan "
            "skipped");
}

TEST(LoopDetector, RejectsVerificationWithoutYaw) {
  FeatureExtractor blind = first_point();
  blind.comparison.relative_yaw = nullptr;
  PlaceRecognizer recognizer(blind, {});
  expect_error<UsageError>([&] { LoopDetector(recognizer, {.verify = true}); }, {"relative yaw"});
  EXPECT_FALSE(LoopDetector(recognizer, {}).verifies()) << "by default only where it can be";
  PlaceRecognizer seeing(first_point(), {});
  EXPECT_TRUE(LoopDetector(seeing, {}).verifies());
  EXPECT_FALSE(LoopDetector(seeing, {.keep_clouds = false}).verifies());
}

}  // namespace
}  // namespace revisit
