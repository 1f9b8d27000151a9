#include "revisit/baselines/baselines.h"
#include "revisit/evaluation/descriptors.h"
#include "revisit/evaluation/protocols.h"
#include "testing.h"

namespace revisit {
namespace {

Point at(double azimuth_deg, double range, double z) {
  return {static_cast<float>(range * std::cos(azimuth_deg * kDegree)),
          static_cast<float>(range * std::sin(azimuth_deg * kDegree)), static_cast<float>(z), 0};
}

std::vector<float> context_of(const PointCloud& cloud, const ScanContextOptions& options) {
  std::vector<float> context(static_cast<size_t>(options.rings) * options.sectors);
  scan_context(cloud, options, context);
  return context;
}

/// Bins have one point of random height in their middle, or none.
PointCloud random_scene(const ScanContextOptions& options, unsigned seed, double yaw_deg = 0) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform;
  PointCloud cloud;
  for (int ring = 0; ring < options.rings; ++ring)
    for (int sector = 0; sector < options.sectors; ++sector) {
      const double height = 5 * uniform(random);
      if (uniform(random) < 0.4) continue;
      cloud.points.push_back(at((sector + 0.5) * 360 / options.sectors + yaw_deg,
                                (ring + 0.5) * options.max_range / options.rings, height));
    }
  return cloud;
}

/// Reference: equations 4 to 6 of the paper, over the columns occupied in both.
double slow_twin(std::span<const float> a, std::span<const float> b,
                 const ScanContextOptions& options) {
  double least = 3;
  for (int shift = 0; shift < options.sectors; ++shift) {
    double sum = 0;
    int columns = 0;
    for (int j = 0; j < options.sectors; ++j) {
      double ab = 0, aa = 0, bb = 0;
      for (int ring = 0; ring < options.rings; ++ring) {
        const double x = a[ring * options.sectors + (j + shift) % options.sectors];
        const double y = b[ring * options.sectors + j];
        ab += x * y;
        aa += x * x;
        bb += y * y;
      }
      if (aa == 0 || bb == 0) continue;
      sum += 1 - ab / std::sqrt(aa * bb);
      ++columns;
    }
    least = std::min(least, columns ? sum / columns : 1);
  }
  return least;
}

double distance(std::span<const float> a, std::span<const float> b,
                const ScanContextOptions& options) {
  double similarity = 0;
  scan_context_features(options).comparison.similarity(a, {&b, 1}, {&similarity, 1});
  return 1 - similarity;
}

TEST(ScanContext, BinsByHand) {
  // 2 rings of 5 m and 4 sectors of 90 degrees.
  const ScanContextOptions options{.rings = 2, .sectors = 4, .max_range = 10, .sensor_height = 2};
  const float nan = std::nanf("");
  PointCloud cloud;
  cloud.points = {at(45, 1, 0.5),   at(80, 4.9, 1),
                  at(10, 3, -1),                          // ring 0, sector 0: highest 1 + 2
                  at(135, 7, -2.5),                       // ring 1, sector 1: -2.5 + 2
                  at(200, 10, 0),                         // exactly max_range: the last ring
                  at(359, 1, 3),                          // ring 0, sector 3
                  at(300, 10.1, 9),                       // too far
                  {0, 0, 0, 0},     {nan, nan, nan, 0}};  // no returns
  EXPECT_EQ(context_of(cloud, options), (std::vector<float>{3, 0, 0, 5, 0, -0.5F, 2, 0}));
  EXPECT_EQ(ring_key(context_of(cloud, options), options), (std::vector<float>{0.5F, 0.5F}));
}

TEST(ScanContext, DistanceByHand) {
  // Columns of a: (3,4) (0,0) (1,0); of b: (0,2) (3,0) (0,0).
  const ScanContextOptions options{.rings = 2, .sectors = 3};
  const std::vector<float> a{3, 0, 1, 4, 0, 0}, b{0, 3, 0, 2, 0, 0};
  // Shift 0: only column 0 meets an occupied one: cos((3,4),(0,2)) = 0.8.
  // Shift 1: a becomes (0,0) (1,0) (3,4): column 1, cos((1,0),(3,0)) = 1.
  // Shift 2: a becomes (1,0) (3,4) (0,0): cosines 0 and 0.6, mean 0.3.
  EXPECT_NEAR(distance(a, b, options), 0, 1e-7);
  const std::vector<float> only_first{3, 0, 0, 4, 0, 0};
  EXPECT_NEAR(distance(only_first, b, options), 1 - 0.8, 1e-7);
  EXPECT_EQ(distance(std::vector<float>(6), b, options), 1) << "nothing meets";
}

TEST(ScanContext, AgreesWithTheSlowTwin) {
  const ScanContextOptions options{.rings = 7, .sectors = 11};
  for (unsigned seed = 0; seed < 20; ++seed) {
    const auto a = context_of(random_scene(options, seed), options);
    const auto b = context_of(random_scene(options, seed + 100), options);
    EXPECT_NEAR(distance(a, b, options), slow_twin(a, b, options), 1e-6) << seed;
  }
}

TEST(ScanContext, YawOfWholeSectorsIsAColumnShift) {
  const ScanContextOptions options;
  const auto straight = context_of(random_scene(options, 1), options);
  for (const int sectors : {1, 17, 30, 59}) {
    const auto turned = context_of(random_scene(options, 1, 6.0 * sectors), options);
    for (int ring = 0; ring < options.rings; ++ring)
      for (int column = 0; column < options.sectors; ++column)
        ASSERT_EQ(turned[ring * 60 + (column + sectors) % 60], straight[ring * 60 + column]);
    EXPECT_EQ(ring_key(turned, options), ring_key(straight, options));
    EXPECT_NEAR(distance(turned, straight, options), 0, 1e-6);
  }
}

class ScanContextRetrieval : public testing::Test {
 protected:
  /// Ten scenes, and the third of them again, rotated by 90 degrees.
  ScanContextRetrieval() : descriptors_(11, 1200) {
    for (unsigned i = 0; i < 10; ++i) scan_context(random_scene({}, i), {}, descriptors_.row(i));
    scan_context(random_scene({}, 2, 90), {}, descriptors_.row(10));
    for (int64_t i = 0; i < 10; ++i) task_.stored.push_back(i);
    task_.queries.push_back({10, {CandidateRange{0, 10}, {}}});
  }
  FloatMatrix descriptors_;
  Task task_;
};

TEST_F(ScanContextRetrieval, FindsTheTurnedScene) {
  const Match match = retrieve({descriptors_, {}, scan_context_features().comparison}, task_).at(0);
  EXPECT_EQ(match.ranks[0], 2);
  EXPECT_NEAR(match.similarities[0], 1, 1e-6);
  for (size_t i = 1; i < 4; ++i)
    EXPECT_NEAR(match.similarities[i],
                1 - slow_twin(descriptors_.row(10), descriptors_.row(match.ranks[i]), {}), 1e-6);
}

TEST_F(ScanContextRetrieval, RingKeysChooseTheCandidates) {
  const FeatureExtractor two = scan_context_features({.candidates = 2});
  const Match match = retrieve({descriptors_, {}, two.comparison}, task_).at(0);
  EXPECT_EQ(match.ranks[0], 2);
  EXPECT_GT(match.similarities[1], -1);
  EXPECT_EQ(match.similarities[2], -1) << "left out by the ring keys";
}

TEST(ScanContext, RefusesNonsense) {
  expect_error<UsageError>([] { scan_context_features({.rings = 0}); }, {"rings"});
  expect_error<UsageError>([] { scan_context_features({.sectors = 100000}); }, {"sectors"});
  expect_error<UsageError>([] { scan_context_features({.max_range = 0}); }, {"range"});
  expect_error<UsageError>([] { scan_context_features({.candidates = -1}); }, {"candidates"});
}

}  // namespace
}  // namespace revisit
