#include "ring/extraction.h"
#include "testing.h"

namespace revisit {
namespace {

/// Bins 0-10, 10-20 and 20-40 m, bands from 1 and 3 m, four sectors: azimuths 270 to 360 degrees,
/// 180 to 270, 90 to 180, 0 to 90.
TEST(PolarRing, ByHand) {
  const RingGrid grid{.sectors = 4, .distances = {0, 10, 20, 40}, .bands = {1, 3}};
  const PointCloud cloud{{{3, 4, -1.5F, 0},   // 5 m ahead at the left: sector 3, 0.5 m high
                          {4, 3, 2, 0},       // there, 4 m high
                          {9, 12, -2, 0},     // 15 m, the ground
                          {-30, 1, 0, 0},     // 30 m, behind at the left: sector 2, 2 m high
                          {-6, -8, 0.5F, 0},  // exactly 10 m, sector 1: the second bin, 2.5 m
                          {60, -60, 1, 0},    // beyond the last bin: sector 0 is seen, no return
                          {NAN, 1, 1, 0},
                          {}}};  // no returns
  std::vector<float> ring(36, -1), seen(12, -1);
  polar_ring(cloud, grid, 2, ring, seen);
  const std::vector<float> highest = {0, 0,    0, 4,  //
                                      0, 2.5F, 0, 0,  //
                                      0, 0,    2, 0},
                           low = {0, 0, 0, 0,  //
                                  0, 1, 0, 0,  //
                                  0, 0, 1, 0},
                           high = {0, 0, 0, 1,  //
                                   0, 0, 0, 0,  //
                                   0, 0, 0, 0};
  const std::vector<float> seen_by_hand = {1, 1, 1, 1,  //
                                           1, 1, 1, 1,  //
                                           1, 0, 1, 0};
  EXPECT_EQ(std::vector<float>(ring.begin(), ring.begin() + 12), highest);
  EXPECT_EQ(std::vector<float>(ring.begin() + 12, ring.begin() + 24), low);
  EXPECT_EQ(std::vector<float>(ring.begin() + 24, ring.end()), high);
  EXPECT_EQ(seen, seen_by_hand);
}

TEST(PolarRing, OfNothingIsNothing) {
  const RingGrid grid;
  std::vector<float> ring(static_cast<size_t>(grid.features() * grid.sectors), -1),
      seen(static_cast<size_t>(grid.bins() * grid.sectors), -1);
  polar_ring({}, grid, 2, ring, seen);
  for (const auto* values : {&ring, &seen})
    for (const float value : *values) EXPECT_EQ(value, 0);
}

TEST(BetweenBeams, FillsNarrowGapsAlongOneOverRange) {
  // Columns: a gap of two, one of three, no lower end, no gap.
  const RangeImage image{4, 6, {100, 100, 0,  10,  //
                                0,   0,   0,  20,  //
                                0,   0,   50, 30,  //
                                25,  0,   0,  40,  //
                                0,   25,  0,  50,  //
                                50,  0,   0,  60}};
  RangeImage filled = image;
  fill_between_beams(filled, 2);
  // 1/100 to 1/25 in three steps: 2/100, 3/100. 1/25 to 1/50 in two: 3/100.
  EXPECT_FLOAT_EQ(filled.at(1, 0), 50);
  EXPECT_FLOAT_EQ(filled.at(2, 0), 100 / 3.0F);
  EXPECT_FLOAT_EQ(filled.at(4, 0), 100 / 3.0F);
  for (int row = 0; row < 6; ++row)
    for (const int column : {1, 2, 3}) EXPECT_EQ(filled.at(row, column), image.at(row, column));
}

}  // namespace
}  // namespace revisit
