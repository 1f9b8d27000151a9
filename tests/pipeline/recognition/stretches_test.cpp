#include "revisit/recognition/stretches.h"

#include <cmath>

#include "testing.h"

namespace revisit {
namespace {

/// Views are directions: their similarity is the cosine of the angle between them.
struct Walk {
  PlaceIndex index{2};
  Stretches stretches{0.45};  // 63 degrees
  bool poses = true;
  int64_t frame = 0;

  void add(const std::string& drive, double meters, double degrees) {
    const double angle = degrees * M_PI / 180;
    index.add(std::vector<float>{static_cast<float>(std::cos(angle)),
                                 static_cast<float>(std::sin(angle))});
    DriveScan scan{.drive = drive, .frame = frame++};
    if (poses) scan.pose.emplace(Eigen::Translation3d(meters, 0, 0));
    stretches.add({&scan, 1}, index);
  }
};

/// A street turns the view by 10 degrees per meter, so its stretches have 7 m. In the tunnel, from
/// 70 to 170 m, the view swings by 50 degrees: it changes, but always looks like the first one.
TEST(Stretches, OnlyATunnelIsLong) {
  for (const bool poses : {true, false}) {
    Walk walk{.poses = poses};
    for (int meters = 0; meters < 240; ++meters) {
      const bool in_tunnel = meters >= 70 && meters < 170;
      walk.add("d", meters, in_tunnel ? 700 + 25 * (meters % 3) : 10 * meters);
    }
    for (int meters = 0; meters < 240; ++meters)
      EXPECT_EQ(walk.stretches.is_long(meters), meters >= 70 && meters < 170) << meters;
    EXPECT_EQ(walk.stretches.around(72).size(), 100);
    EXPECT_EQ(walk.stretches.around(7).front(), 7);
    EXPECT_EQ(walk.stretches.near(8).size(), 21) << "with the stretches before and behind";
    EXPECT_FALSE(walk.stretches.is_long(240)) << "not added yet";
  }
}

TEST(Stretches, HaltsAndRepeatedStreetsAreNotLong) {
  for (const bool poses : {true, false}) {
    Walk walk{.poses = poses};
    for (int pass = 0; pass < 4; ++pass)
      for (int meters = 0; meters < 70; ++meters)
        for (int halt = 0; halt == 0 || (meters == 40 && halt < 300); ++halt)
          walk.add(str(pass % 2), meters, 10 * meters + 0.1 * (halt % 2));
    for (int64_t entry = 0; entry < walk.stretches.size(); ++entry)
      EXPECT_FALSE(walk.stretches.is_long(entry)) << entry;
  }
}

/// Several processes add the scans of a drive in blocks, in any order.
TEST(Stretches, FollowTheFramesOfADrive) {
  Walk walk;
  std::vector<DriveScan> scans;
  for (const int frame : {7, 0, 1, 8, 6, 2, 5, 3, 4}) {
    const double angle = frame * M_PI / 18;
    walk.index.add(std::vector<float>{static_cast<float>(std::cos(angle)),
                                      static_cast<float>(std::sin(angle))});
    scans.push_back({.drive = "d", .frame = frame});
  }
  walk.stretches.add(scans, walk.index);
  EXPECT_EQ(walk.stretches.count(), 2);
  EXPECT_EQ(walk.stretches.around(3).size(), 2) << "frames 7 and 8";
  EXPECT_EQ(walk.stretches.around(1).size(), 7);
}

}  // namespace
}  // namespace revisit
