#include "revisit/loops/loop_detector.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "expect_error.h"

namespace revisit::pipeline {
namespace {

using test::expect_error;

/// The feature of a scan is its first point: scans of one place have equal ones.
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
  extractor.comparison.turn = [](std::span<const float>, std::span<const float>) { return 0.0; };
  return extractor;
}

/// A room of walls and pillars; rooms of one angle [rad] are one place.
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
      add(along, 4 * z - 3, -1.5);  // the floor
    }
  return cloud;
}

int64_t match_of(LoopDetector& detector, double angle, const ScanStamp& stamp) {
  const PointCloud cloud = room(angle);
  const Detection found = detector.take(view_of(cloud), stamp);
  EXPECT_TRUE(found.position) << found.why_not;
  return found.loop ? found.loop->position : -1;
}

TEST(LoopDetector, RecentScansAreNoLoops) {
  const auto stamp = [](int64_t frame) {
    ScanStamp scan{.frame = frame, .time = 0.5 * static_cast<double>(frame)};
    scan.pose.emplace(Eigen::Translation3d(2.0 * static_cast<double>(frame), 0, 0));
    return scan;
  };
  for (const char* exclusion : {"frames=2", "seconds=1", "metres=4"}) {
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

TEST(LoopDetector, AScanWithoutDescriptionIsNoPlace) {
  PlaceRecognizer recognizer(first_point(), {});
  LoopDetector detector(recognizer, {});
  PointCloud one;
  one.points.push_back({1, 2, 3, 0});
  const Detection found = detector.take(view_of(one), {});
  EXPECT_FALSE(found.position);
  EXPECT_FALSE(found.loop);
  EXPECT_EQ(found.why_not, "fewer than two points");
  EXPECT_EQ(recognizer.size(), 0);
}

TEST(LoopDetector, AcceptedLoopsAreRegistered) {
  PlaceRecognizer recognizer(first_point(), {.threshold = 0.9});
  const LoopDetectorOptions options{
      .drive = "monday", .exclusion = parse_exclusion("none"), .verify = true};
  LoopDetector detector(recognizer, options);
  for (const double angle : {0.0, 2.0, 4.0, 5.0}) match_of(detector, angle, {});
  const PointCloud cloud = room(2);
  const Detection found = detector.take(view_of(cloud), {});
  ASSERT_TRUE(found.loop && found.registered);
  EXPECT_EQ(found.loop->position, 1);
  EXPECT_EQ(found.loop->drive, "monday");
  EXPECT_TRUE(found.registered->accepted);
  EXPECT_TRUE(found.loop->accepted);
  EXPECT_TRUE(found.registered->T_place_query.isApprox(Eigen::Isometry3d::Identity(), 0.01));

  PointCloud other = room(2);  // looks alike, but its walls are elsewhere
  for (size_t i = 1; i < other.points.size(); ++i) other.points[i].x *= 2.5F;
  const Detection rejected = detector.take(view_of(other), {});
  ASSERT_TRUE(rejected.loop && rejected.registered);
  EXPECT_FALSE(rejected.registered->accepted);
  EXPECT_FALSE(rejected.loop->accepted);
}

TEST(LoopDetector, VerificationNeedsAHeading) {
  FeatureExtractor blind = first_point();
  blind.comparison.turn = nullptr;
  PlaceRecognizer recognizer(blind, {});
  expect_error<UsageError>([&] { LoopDetector(recognizer, {.verify = true}); }, {"heading"});
}

}  // namespace
}  // namespace revisit::pipeline
