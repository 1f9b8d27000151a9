#include "revisit/evaluation/ground_truth.h"

#include "testing.h"
#include "trajectory.h"

namespace revisit {
namespace {

Trajectory along_x(const std::vector<double>& xs) {
  std::vector<Pose> poses;
  for (const double x : xs) {
    Pose pose = Pose::Identity();
    pose.translation().x() = x;
    poses.push_back(pose);
  }
  return trajectory_of(poses);
}

TEST(GroundTruth, DistancesByHand) {
  const Eigen::Vector3d a(1, 2, 3), b(4, 14, 7);  // differences 3, 12, 4
  EXPECT_DOUBLE_EQ(distance_between(a, b, Distance::kXz), 5);
  EXPECT_DOUBLE_EQ(distance_between(a, b, Distance::kXy), std::hypot(3, 12));
  EXPECT_DOUBLE_EQ(distance_between(a, b, Distance::k3d), 13);
  EXPECT_DOUBLE_EQ(distance_between(a, b, Distance::kBox), 12);
}

TEST(GroundTruth, RadiusIsStrict) {
  EXPECT_FALSE((MatchRule{Distance::kBox, 3}).is_correct(3));
  EXPECT_TRUE((MatchRule{Distance::kBox, 3}).is_correct(std::nextafter(3.0, 0.0)));
}

TEST(GroundTruth, BetweenRadiusAndFalseBeyondItIsNeither) {
  const MatchRule rule{Distance::kXz, 3, 20};
  const auto at = [&](double x) { return std::pair(rule.is_correct(x), rule.is_incorrect(x)); };
  EXPECT_EQ(at(2.9), std::pair(true, false));
  EXPECT_EQ(at(3), std::pair(false, false));
  EXPECT_EQ(at(20), std::pair(false, false));
  EXPECT_EQ(at(20.1), std::pair(false, true));
  EXPECT_TRUE((MatchRule{Distance::kXz, 5}).is_incorrect(5));  // default: complement of true
  EXPECT_TRUE((MatchRule{Distance::kXz, 5, 4}).is_incorrect(5));
  EXPECT_FALSE((MatchRule{Distance::kXz, 5, 4}).is_incorrect(4.9));
}

TEST(GroundTruth, NamedPlacesAreNearOrInfinitelyFar) {
  Trajectory set;
  set.frames = {0, 1, 2};
  set.places = {"library", "gate", "library"};
  EXPECT_EQ(distance_between(set, 0, 2, Distance::kPlace), 0);
  EXPECT_EQ(distance_between(set, 0, 1, Distance::kPlace), HUGE_VAL);
  EXPECT_EQ(find_loops(set, {Distance::kPlace, 1}, parse_exclusion("none")),
            (std::vector<std::pair<int64_t, int64_t>>{{2, 0}}));
  EXPECT_THROW(find_loops(set, {Distance::kXz, 5}, parse_exclusion("none")), UsageError);
  EXPECT_THROW(find_loops(along_x({0, 1}), {Distance::kPlace, 1}, {}), UsageError);
  EXPECT_EQ(parse_distance("place"), Distance::kPlace);
  EXPECT_STREQ(name_of(Distance::kPlace), "place");
}

TEST(GroundTruth, ParsesExclusions) {
  for (const char* text : {"frames=50", "seconds=30", "meters=50", "none", "seconds=0.5",
                           "frames=0", "frames=1234567", "meters=49.9999999"})
    EXPECT_EQ(to_string(parse_exclusion(text)), text);
  for (const char* text :
       {"", "frames", "frames=", "frames=-1", "frames=1.5", "frames=x", "miles=50", "50",
        "meters=nan", "meters=inf", "frames=50 ", "none=1", "seconds=1e400"})
    EXPECT_THROW(parse_exclusion(text), UsageError) << text;
  EXPECT_THROW(parse_distance("yz"), UsageError);
}

TEST(GroundTruth, AnExclusionWithoutItsAmountIsNoMisspelling) {
  const auto message = [](const char* text) {
    return message_of<UsageError>([&] { parse_exclusion(text); });
  };
  for (const char* text : {"frames", "frames=-1", "seconds=nan", "none=1"})
    EXPECT_EQ(message(text).find("did you mean"), std::string::npos) << message(text);
  EXPECT_HAS(message("meter=50"), "did you mean 'meters'");
}

TEST(GroundTruth, CandidatesAreMoreThanTheExclusionAway) {
  const Trajectory drive = along_x({0, 1, 2, 3, 4});
  using V = std::vector<int64_t>;
  EXPECT_EQ(earlier_candidates(drive, parse_exclusion("frames=2")), (V{0, 0, 0, 1, 2}));
  EXPECT_EQ(later_candidates(drive, parse_exclusion("frames=2")), (V{3, 4, 5, 5, 5}));
  EXPECT_EQ(earlier_candidates(drive, parse_exclusion("none")), (V{0, 1, 2, 3, 4}));
  EXPECT_EQ(later_candidates(drive, parse_exclusion("none")), (V{1, 2, 3, 4, 5}));
  EXPECT_EQ(earlier_candidates(drive, parse_exclusion("frames=0")), (V{0, 1, 2, 3, 4}));
  EXPECT_EQ(later_candidates(drive, parse_exclusion("frames=0")), (V{1, 2, 3, 4, 5}));
}

TEST(GroundTruth, ExclusionCountsFrameNumbersSecondsOrDrivenMeters) {
  Trajectory drive = along_x({0, 10, 0, 10});  // there, back, and there again: 30 m driven
  drive.frames = {0, 100, 101, 300};
  drive.times = {0, 1, 50, 51};
  using V = std::vector<int64_t>;
  EXPECT_EQ(earlier_candidates(drive, parse_exclusion("frames=50")), (V{0, 1, 1, 3}));
  EXPECT_EQ(earlier_candidates(drive, parse_exclusion("seconds=30")), (V{0, 0, 2, 2}));
  EXPECT_EQ(earlier_candidates(drive, parse_exclusion("meters=10")), (V{0, 0, 1, 2}));
  Trajectory halt = along_x({0, 1, 1.2, 0.9, 1.3, 1, 1.1, 2.4});  // noise of a halt is no path
  EXPECT_EQ(earlier_candidates(halt, parse_exclusion("meters=1.5")), (V{0, 0, 0, 0, 0, 0, 0, 1}));
  drive.times = {0, 2, 1, 3};
  EXPECT_THROW(earlier_candidates(drive, parse_exclusion("seconds=30")), InputError);
  drive.times.clear();
  EXPECT_THROW(earlier_candidates(drive, parse_exclusion("seconds=30")), UsageError);
  drive.positions.clear();
  EXPECT_THROW(earlier_candidates(drive, parse_exclusion("meters=30")), UsageError);
}

TEST(GroundTruth, LoopsByHand) {
  //                             0  1   2   3   4  5    (5 comes back to 0 and 1)
  const Trajectory drive = along_x({0, 1, 20, 40, 20, 0.5});
  EXPECT_EQ(find_loops(drive, {Distance::kXz, 5}, parse_exclusion("frames=2")),
            (std::vector<std::pair<int64_t, int64_t>>{{5, 0}, {5, 1}}))
      << "4 and 2 are only two frames apart";
}

TEST(GroundTruth, RefusesNonsense) {
  const Trajectory drive = along_x({0, 1});
  for (const double radius : {0.0, -1.0, std::nan(""), HUGE_VAL})
    EXPECT_THROW(find_loops(drive, {Distance::kXz, radius}, {}), UsageError) << radius;
  EXPECT_THROW(find_loops({}, {Distance::kXz, 5}, {}), UsageError);
  EXPECT_THROW(along_x({0, std::nan("")}), InputError);
}

TEST(GroundTruth, DatasetFramesMustIncrease) {
  Dataset dataset;
  dataset.scans = {{"a.bin", 3, {}, {}}, {"b.bin", 3, {}, {}}};
  EXPECT_THROW(make_trajectory(dataset), InputError);
  dataset.scans[1].frame = 7;
  EXPECT_EQ(make_trajectory(dataset).frames, (std::vector<int>{3, 7}));
  EXPECT_TRUE(make_trajectory(dataset).positions.empty());
}

TEST(GroundTruth, OfficialPosesGiveTheKnownCounts) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  const auto positives = [](const Trajectory& drive, const MatchRule& rule) {
    std::set<int64_t> queries;
    for (const auto& [query, match] : find_loops(drive, rule, parse_exclusion("frames=50")))
      queries.insert(query);
    return std::ssize(queries);
  };
  const std::pair<const char*, int64_t> known[] = {
      {"00", 804}, {"05", 503}, {"06", 270}, {"08", 345}};
  for (const auto& [sequence, count] : known) {
    const Trajectory drive =
        trajectory_of(read_kitti_poses(kitti / "poses" / str(sequence, ".txt")));
    EXPECT_EQ(positives(drive, {Distance::kXz, 5}), count) << sequence;
  }
  // The height of 08 drifts.
  const Trajectory drive = trajectory_of(read_kitti_poses(kitti / "poses/08.txt"));
  EXPECT_EQ(positives(drive, {Distance::k3d, 3}), 158);
  EXPECT_EQ(positives(drive, {Distance::kXz, 3}), 318);
}

}  // namespace
}  // namespace revisit
