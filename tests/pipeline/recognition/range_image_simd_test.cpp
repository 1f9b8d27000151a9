#include "naive_range_image.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/recognition/align.h"
#include "simd_targets.h"
#include "testing.h"

namespace revisit {
namespace {

ImageGeometry geometry(int width, int height) {
  return {.width = width, .height = height};
}

/// Neighbors differ in the last bits of their floats.
void add_with_neighbors(double x, double y, double z, PointCloud* cloud) {
  const auto moved = [](double value, int steps) {
    auto v = static_cast<float>(value);
    for (; steps > 0; --steps) v = std::nextafter(v, std::numeric_limits<float>::infinity());
    for (; steps < 0; ++steps) v = std::nextafter(v, -std::numeric_limits<float>::infinity());
    return v;
  };
  for (int dx = -2; dx <= 2; ++dx)
    for (int dy = -2; dy <= 2; ++dy)
      for (int dz = -1; dz <= 1; ++dz)
        cloud->points.push_back({moved(x, dx), moved(y, dy), moved(z, dz), 0});
}

/// Compares single points, because images would hide the farther of two.
void expect_pixels_of_the_formula(const PointCloud& cloud, const ImageGeometry& g) {
  for (const Point& p : cloud.points) {
    const RangeImage expected = project_naively({{p}}, g), found = project({{p}}, g);
    ASSERT_EQ(count_differing(found, expected, kRounding), 0)
        << g.width << " x " << g.height << ": " << p.x << ", " << p.y << ", " << p.z;
  }
}

TEST(ProjectSimd, PointsOnBordersFallWhereDoubleArithmeticPutsThem) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> range(1, 90);
  for (const ImageGeometry& g : {geometry(40, 8), geometry(41, 7), geometry(3, 1)}) {
    const double row_height = (g.elevation_top - g.elevation_bottom) / g.height;
    for (int column = 0; column < g.width; ++column)
      for (int row = 0; row <= g.height; ++row) {
        const double azimuth = kPi - column * 2 * kPi / g.width, r = range(random);
        const double elevation = (g.elevation_top - row * row_height) * kPi / 180;
        PointCloud corner;
        add_with_neighbors(r * std::cos(elevation) * std::cos(azimuth),
                           r * std::cos(elevation) * std::sin(azimuth), r * std::sin(elevation),
                           &corner);
        expect_pixels_of_the_formula(corner, g);
      }
  }
}

TEST(ProjectSimd, ExtremesOfFloat) {
  PointCloud cloud;
  const float huge = std::numeric_limits<float>::max(), tiny = 1e-44F;
  for (const float x : {huge, 1e19F, 3.0F, 1e-19F, tiny, 0.0F})
    for (const float y : {huge, 1e19F, 3.0F, 1e-19F, tiny, 0.0F})
      for (const float z : {huge, 1.0F, 0.3F, 1e-19F, tiny, 0.0F})
        for (const float sign : {1.0F, -1.0F})
          cloud.points.insert(cloud.points.end(),
                              {{sign * x, y, z, 0}, {x, sign * y, -z, 0}, {-x, -y, sign * z, 0}});
  ImageGeometry whole = geometry(36, 18);
  whole.elevation_top = 90;
  whole.elevation_bottom = -90;
  expect_pixels_of_the_formula(cloud, geometry(40, 8));
  for (const Point& p : cloud.points) {
    if (p.x == 0 && p.y == 0) continue;  // the zenith has no column
    ASSERT_EQ(count_differing(project({{p}}, whole), project_naively({{p}}, whole), kRounding), 0)
        << p.x << ", " << p.y << ", " << p.z;
  }
}

TEST(ProjectSimd, FineImagesNeedDoubleArithmeticEverywhere) {
  ImageGeometry g = geometry(65536, 64);
  g.elevation_top = 0.001;
  g.elevation_bottom = -0.001;
  PointCloud cloud = random_cloud(8, 5000);
  for (Point& p : cloud.points) p.z *= 1e-4F;
  EXPECT_EQ(count_differing(project(cloud, g), project_naively(cloud, g), kRounding), 0);
}

TEST(ProjectSimd, TurnedOnTheWayIsTheTurnedCloud) {
  const PointCloud cloud = random_cloud(6, 5003);
  const Eigen::Matrix3f R = principal_alignment(cloud).R_aligned_sensor;
  const ImageGeometry g;
  RangeImage image;
  project_rotated(cloud, R, g, image);
  EXPECT_EQ(image.pixels, project(rotated(cloud, R), g).pixels);
}

TEST(ProjectSimd, CountsThePointsOutsideOfTheImage) {
  PointCloud cloud = random_cloud(6, 5003);
  cloud.points[17] = {std::nanf(""), 1, 1, 0};
  cloud.points[18] = {};
  cloud.points[19] = {0, 0, 5, 0};  // zenith, where float arithmetic is undecided
  const ImageGeometry g = geometry(41, 7);
  int64_t returns = 0, outside = 0;
  for (const Point& p : cloud.points) {
    returns += is_return(p) ? 1 : 0;
    const std::vector<float> pixels = project_naively({{p}}, g).pixels;
    outside += is_return(p) && std::ranges::all_of(pixels, [](float x) { return x == 0; }) ? 1 : 0;
  }
  ASSERT_EQ(returns, 5001);
  ASSERT_GT(outside, 100);
  test::for_each_simd_target([&] {
    RangeImage image;
    project_rotated(cloud, Eigen::Matrix3f::Identity(), g, image);
    EXPECT_EQ(image.returns, returns);
    EXPECT_EQ(image.outside, outside);
    EXPECT_DOUBLE_EQ(image.outside_share(),
                     static_cast<double>(outside) / static_cast<double>(returns));
  });
  RangeImage image;
  project_rotated({}, Eigen::Matrix3f::Identity(), g, image);
  EXPECT_EQ(image.outside_share(), 0);
}

TEST(ProjectSimd, MemoryIsUsedAgain) {
  const PointCloud cloud = random_cloud(6, 500);
  const ImageGeometry g;
  RangeImage image = project(random_cloud(7, 5000), g);
  const float* const memory = image.pixels.data();
  project_rotated(cloud, Eigen::Matrix3f::Identity(), g, image);
  image = close_holes(std::move(image), g);
  EXPECT_EQ(image.pixels.data(), memory);
  EXPECT_EQ(image.pixels, close_holes(project(cloud, g), g).pixels) << "of the old image, too";
}

TEST(ProjectSimd, AnyNumberOfPoints) {
  const ImageGeometry g = geometry(100, 20);
  for (int n = 0; n < 40; ++n) {
    const PointCloud cloud = random_cloud(static_cast<unsigned>(n), n);
    EXPECT_EQ(count_differing(project(cloud, g), project_naively(cloud, g), kRounding), 0) << n;
  }
}

TEST(Simd, TheSameBitsWithEverySetOfInstructions) {
  PointCloud cloud = random_cloud(9, 20003);
  cloud.points[17] = {std::nanf(""), 1, 1, 0};
  cloud.points[18] = {};
  if (const auto file = test::shared("data/kitti/sequences/00/velodyne/000052.bin"); !file.empty())
    cloud = read_scan(file);
  const auto image_of = [&] {
    const ImageGeometry g;
    RangeImage image;
    project_rotated(cloud, principal_alignment(cloud).R_aligned_sensor, g, image);
    return close_holes(std::move(image), g).pixels;
  };
  const std::vector<float> usual = image_of();
  test::for_each_simd_target([&] { EXPECT_EQ(image_of(), usual); });
}

}  // namespace
}  // namespace revisit
