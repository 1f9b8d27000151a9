#include "camera.h"

#include "drive.h"
#include "fabmap.h"
#include "revisit/datasets/scan_file.h"
#include "testing.h"
#include "town.h"
#include "world.h"

namespace revisit {
namespace {

using namespace simulation;
using Vec3 = Eigen::Vector3f;

double mean_of(const Texture& texture, float footprint) {
  double sum = 0;
  for (int row = 0; row < 64; ++row)
    for (int column = 0; column < 64; ++column)
      sum += static_cast<double>(texture.at(0.01f * (static_cast<float>(column) + 0.5f),
                                            0.01f * (static_cast<float>(row) + 0.5f), footprint));
  return sum / (64 * 64);
}

TEST(Texture, KeepsItsMeanAndAveragesWithinAPixel) {
  // Squares of 4 texels of 1 cm: 0.5 and 1.5.
  const Texture checkers(64, 0.01, [](int x, int y) { return (x / 4 + y / 4) % 2 ? 1.5 : 0.5; });
  for (const float footprint : {0.001f, 0.01f, 0.03f, 0.1f, 5.f})
    EXPECT_NEAR(mean_of(checkers, footprint), 1, 0.005) << footprint;
  EXPECT_NEAR(checkers.at(0.02f, 0.02f, 0.01f), 0.5, 0.005);
  EXPECT_NEAR(checkers.at(0.06f, 0.02f, 0.01f), 1.5, 0.005);
  for (const float x : {0.02f, 0.06f, 0.31f}) EXPECT_NEAR(checkers.at(x, 0.02f, 0.08f), 1, 0.005);
}

TEST(Texture, RepeatsAlsoBelowZero) {
  const Texture texture(32, 0.02, [](int x, int y) { return (x * 7 + y * 3) % 32 / 16.0; });
  for (const float footprint : {0.02f, 0.05f})
    EXPECT_NEAR(texture.at(0.1f, 0.2f, footprint),
                texture.at(0.1f - 0.64f, 0.2f + 1.28f, footprint), 1e-3f);
}

constexpr int kWidth = 320, kHeight = 120;

/// Camera 1 m above the ground, looking along x; 200 pixels are a slope of 1.
CameraModel hand_camera() {
  CameraModel model;
  model.width = kWidth, model.height = kHeight;
  model.K << 200, 0, 160, 0, 200, 60, 0, 0, 1;
  Eigen::Matrix3d axes;  // camera right, down, forward
  axes << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  model.T_velo_cam = Pose::Identity();
  model.T_velo_cam.linear() = axes;
  model.T_velo_cam.translation() = Eigen::Vector3d(0, 0, 1);
  return model;
}

GrayImage picture_of(Mesh mesh, const Light& light, int frame = 0) {
  static const Textures textures;
  const Scene scene(std::move(mesh));
  RayCaster rays(scene);
  Camera camera(hand_camera(), textures, 1);
  return camera.picture(frame, Pose::Identity(), light, rays);
}

/// Mean of 5 x 5 pixels around the projection.
double seen_at(const GrayImage& image, double x, double y, double z) {
  const int column = static_cast<int>(std::lround(160 - 200 * y / x));
  const int row = static_cast<int>(std::lround(60 - 200 * (z - 1) / x));
  double sum = 0;
  for (int i = -2; i <= 2; ++i)
    for (int j = -2; j <= 2; ++j)
      sum += image.pixels.at(static_cast<size_t>((row + i) * image.width + column + j));
  return sum / 25;
}

Mesh floor_of(double reflectance) {
  Mesh mesh;
  mesh.quad({-9, -99, 0}, {99, -99, 0}, {99, 99, 0}, {-9, 99, 0},
            surface(Material::kSolid, reflectance));
  return mesh;
}

Light sunlight(const Vec3& to_sun, float sky) {
  Light light;
  light.to_sun = to_sun.normalized();
  light.sun = 1, light.sky = sky;
  return light;
}

TEST(Camera, SeesAThingWhereTheProjectionSaysItIs) {
  Mesh mesh = floor_of(0.05);
  // A white board of 40 x 40 cm, 10 m ahead, 2 m to the left, 1.5 m high: pixel (120, 50).
  mesh.quad({10, 1.8f, 1.3f}, {10, 2.2f, 1.3f}, {10, 2.2f, 1.7f}, {10, 1.8f, 1.7f},
            surface(Material::kSolid, 1));
  mesh.quad({20, -99, 0}, {20, 99, 0}, {20, 99, 99}, {20, -99, 99},
            surface(Material::kSolid, 0.05));
  const GrayImage image = picture_of(mesh, sunlight({-1, 0, 1}, 0.3f));
  ASSERT_EQ(image.width, kWidth);
  ASSERT_EQ(image.height, kHeight);
  double sum = 0, columns = 0, rows = 0;
  for (int row = 0; row < kHeight; ++row)
    for (int column = 0; column < kWidth; ++column)
      if (image.pixels[static_cast<size_t>(row * kWidth + column)] > 200)
        ++sum, columns += column, rows += row;
  ASSERT_GE(sum, 7 * 7);  // 8 pixels a side
  ASSERT_LE(sum, 9 * 9);
  EXPECT_NEAR(columns / sum, 120, 0.5);
  EXPECT_NEAR(rows / sum, 50, 0.5);
}

TEST(Camera, ShadowsFallAwayFromTheSun) {
  Mesh mesh = floor_of(0.4);
  // A level board 2 m wide at height 3 m, above the lines of sight to the ground. The sun is at the
  // left at 45 degrees: the board's shadow falls 3 m to the right (y - 3).
  mesh.quad({7, -1, 3}, {9, -1, 3}, {9, 1, 3}, {7, 1, 3}, surface(Material::kSolid, 0.4));
  const GrayImage image = picture_of(mesh, sunlight({0, 1, 1}, 0.1f));
  const double lit = seen_at(image, 8, 0, 0);
  EXPECT_LT(seen_at(image, 8, -3, 0), 0.6 * lit);
  EXPECT_LT(seen_at(image, 8.7, -3.7, 0), 0.6 * lit);
  EXPECT_NEAR(seen_at(image, 8, -4.4, 0), lit, 0.06 * lit);
  EXPECT_NEAR(seen_at(image, 8, 3, 0), lit, 0.06 * lit);
}

TEST(Camera, LambertsLaw) {
  // Two level slabs and one that rises by 45 degrees; the sun is in the zenith, without a sky.
  // Radiance = albedo * cos / pi; the ground reflects light, of which a level slab gets none.
  Mesh mesh;
  mesh.quad({4, 0, 0}, {12, 0, 0}, {12, 8, 0}, {4, 8, 0}, surface(Material::kSolid, 0.6));
  mesh.quad({4, -8, 0}, {12, -8, 0}, {12, 0, 0}, {4, 0, 0}, surface(Material::kSolid, 0.3));
  const GrayImage image = picture_of(mesh, sunlight({0, 0, 1}, 0));
  const auto linear = [](double gray) { return std::pow(gray / 255, 1.8); };
  EXPECT_NEAR(linear(seen_at(image, 8, 2, 0)) / linear(seen_at(image, 8, -2, 0)), 2, 0.06);

  // A level slab under a sun 60 degrees from the zenith, beside one in full sun: a step of cos.
  Mesh roof;
  const float s = std::sqrt(3.f) / 2;
  roof.quad({4, 0, 0}, {12, 0, 0}, {12, 8, 0}, {4, 8, 0}, surface(Material::kSolid, 0.5));
  // A slab that faces the sun at the left: normal (0, s, 0.5).
  roof.quad({4, -2, 0}, {12, -2, 0}, {12, -2 - 0.5f, s}, {4, -2 - 0.5f, s},
            surface(Material::kSolid, 0.5));
  const GrayImage tilted = picture_of(roof, sunlight({0, s, 0.5f}, 0));
  // Level: 0.5 of the sun. Towards the sun: all, and 0.2 * 0.6 * 0.5 * (1 - 0.75) from the ground.
  EXPECT_NEAR(linear(seen_at(tilted, 8, -2.25, 0.43)) / linear(seen_at(tilted, 8, 2, 0)),
              (1 + 0.2 * 0.6 * 0.5 * 0.25) / 0.5, 0.08);
}

TEST(Film, ExposesNoisesAndSaturates) {
  const std::vector<float> even(100 * 90, 0.37f);
  const GrayImage image = develop(even, 100, 90, 0, 7);
  double sum = 0, squares = 0;
  for (const uint8_t p : image.pixels) {
    const double linear = std::pow(p / 255.0, 1.8);
    sum += linear, squares += linear * linear;
  }
  const double mean = sum / 9000, sigma = std::sqrt(squares / 9000 - mean * mean);
  EXPECT_NEAR(mean, 0.22, 0.002);  // for any light
  EXPECT_NEAR(sigma, std::sqrt(0.22 / 6000 + 0.0025 * 0.0025), 0.0007);
  const GrayImage brighter = develop(even, 100, 90, 1, 7);
  EXPECT_NEAR(std::pow(brighter.pixels[50] / 255.0, 1.8), 0.44, 0.03);
  EXPECT_EQ(develop(even, 100, 90, 4, 7).pixels[50], 255);
  EXPECT_NE(develop(even, 100, 90, 0, 8).pixels, image.pixels) << "other noise";
  EXPECT_EQ(develop(std::vector<float>(9000, 0.f), 100, 90, 0, 7).pixels.size(), 9000u)
      << "a dark night is no division by zero";
}

TEST(Light, ChangesSlowlyAndOnlyWhenItShall) {
  for (const uint64_t seed : {1u, 2u, 3u}) {
    double most = 0;
    for (double t = 0; t < 400; t += 0.1) {
      const Light now = light_at(seed, t, true), next = light_at(seed, t + 0.1, true);
      EXPECT_NEAR(now.to_sun.norm(), 1, 1e-5);
      EXPECT_GT(now.to_sun.z(), 0.2f) << "day";
      EXPECT_GT(now.sun + now.sky, 0.2f);
      EXPECT_GT(now.to_sun.dot(next.to_sun), 0.9999f);
      EXPECT_LT(std::abs(now.sun - next.sun), 0.06f);
      EXPECT_LT(std::abs(now.exposure_error), 0.51f);
      most = std::max(most, std::abs(static_cast<double>(now.sun - light_at(seed, 0, true).sun)));
    }
    EXPECT_GT(most, 0.5) << "some cloud in 400 s";
    EXPECT_LT(light_at(seed, 0, true).to_sun.dot(light_at(seed, 100, true).to_sun), 0.975f);
    EXPECT_EQ(light_at(seed, 0, false).to_sun, light_at(seed, 100, false).to_sun);
    EXPECT_EQ(light_at(seed, 0, false).sun, light_at(seed, 100, false).sun);
  }
}

/// Pearson's.
double correlation(const GrayImage& a, const GrayImage& b) {
  double n = 0, sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
  for (size_t i = 0; i < a.pixels.size(); ++i) {
    const double x = a.pixels[i], y = b.pixels[i];
    ++n, sa += x, sb += y, saa += x * x, sbb += y * y, sab += x * y;
  }
  return (sab - sa * sb / n) / std::sqrt((saa - sa * sa / n) * (sbb - sb * sb / n));
}

struct Seen {
  SimulationConfig config;
  Town town;
  Scene scene;
  Textures textures;
  RayCaster rays;
  Camera camera;

  static SimulationConfig config_of(double scale) {
    SimulationConfig config;
    config.length = 600;
    config.camera = true, config.image_scale = scale;
    return config;
  }
  explicit Seen(double scale)
      : config(config_of(scale)),
        town(config),
        scene(town.world.mesh),
        rays(scene),
        camera(town.drive.camera, textures, config.seed) {}

  GrayImage at(size_t frame, const Light& light, int noise) {
    const PlanarPose& p = town.drive.poses[frame];
    Pose T = Pose::Identity();
    T.linear() = Eigen::AngleAxisd(p.yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    T.translation() =
        Eigen::Vector3d(p.x, p.y, town.streets.ground.height({p.x, p.y}) + kSensorHeight);
    return camera.picture(noise, T, light, rays);
  }
  GrayImage at(size_t frame) {
    const Light light = light_at(config.seed, static_cast<double>(frame) * kFramePeriod, true);
    return at(frame, light, static_cast<int>(frame));
  }
};

TEST(Camera, APlaceLooksTheSameButForTheNoise) {
  Seen seen(0.25);
  const Light light = light_at(1, 0, false);
  const GrayImage first = seen.at(40, light, 1), again = seen.at(40, light, 2);
  EXPECT_GT(correlation(first, again), 0.995);
  EXPECT_NE(first.pixels, again.pixels);
  EXPECT_LT(correlation(first, seen.at(100, light, 1)), 0.9);
}

/// Lowe's ratio test.
int matches(const FloatMatrix& a, const FloatMatrix& b) {
  int count = 0;
  for (int64_t i = 0; i < a.n; ++i) {
    float nearest = 1e30F, second = 1e30F;
    for (int64_t j = 0; j < b.n; ++j) {
      float sum = 0;
      for (int64_t k = 0; k < a.d; ++k) {
        const float difference =
            a.row(i)[static_cast<size_t>(k)] - b.row(j)[static_cast<size_t>(k)];
        sum += difference * difference;
      }
      second = std::min(second, std::max(nearest, sum));
      nearest = std::min(nearest, sum);
    }
    count += nearest < 0.5F * second;
  }
  return count;
}

TEST(Camera, APlaceIsRecognizedOnTheNextVisitInOtherLight) {
#ifndef REVISIT_HAVE_OPENCV
  GTEST_SKIP() << "built without OpenCV";
#endif
  Seen seen(0.4);
  const std::vector<PlanarPose>& poses = seen.town.drive.poses;
  std::vector<FloatMatrix> first, second;
  for (size_t i = 30; i < 220; i += 60) {
    const auto distance = [&](size_t j) {
      return std::hypot(poses[i].x - poses[j].x, poses[i].y - poses[j].y);
    };
    size_t visit = poses.size() - 1;
    for (size_t j = i + 300; j < poses.size(); ++j)
      if (distance(j) < distance(visit)) visit = j;
    ASSERT_LT(distance(visit), 1.5);
    first.push_back(sift_descriptors(seen.at(i)));
    second.push_back(sift_descriptors(seen.at(visit)));
  }
  for (size_t i = 0; i < first.size(); ++i) {
    EXPECT_GT(first[i].n, 100);
    const int here = matches(second[i], first[i]);
    for (size_t j = 0; j < first.size(); ++j)
      if (i != j) {
        EXPECT_GT(here, 2 * matches(second[i], first[j])) << i << " and " << j;
      }
  }
}

/// Drives of 4 scans with pictures.
struct SimulateCamera : testing::Test {
  SimulateCamera() {
    config.last_frame = 3;
    config.camera = true, config.image_scale = 0.2;
  }
  fs::path image_path(int frame) const {
    return dir / str("sequences/00/image_0/00000", frame, ".png");
  }
  const TempDir dir;
  SimulationConfig config = quick(dir.path());
};

TEST_F(SimulateCamera, ScansAreAsWithoutACamera) {
  simulate(config);
  config.output = dir / "without";
  config.camera = false;
  simulate(config);
  EXPECT_FALSE(fs::exists(dir / "without/sequences/00/image_0"));
  for (int frame = 0; frame < 4; ++frame) {
    EXPECT_EQ(read_gray_png(image_path(frame)).width, 248);
    EXPECT_EQ(read_gray_png(image_path(frame)).height, 75);
    const std::string scan = str("sequences/00/velodyne/00000", frame, ".bin");
    EXPECT_TRUE(read_file(dir / scan) == read_file(config.output / scan)) << frame;
  }
}

TEST_F(SimulateCamera, AFrameWithoutItsPictureIsMadeAgain) {
  simulate(config);
  const std::string picture = read_file(image_path(2));
  fs::remove(image_path(2));
  const SimulationSummary summary = simulate(config);
  EXPECT_EQ(summary.kept, 3);
  EXPECT_EQ(summary.scans, 4);
  EXPECT_TRUE(read_file(image_path(2)) == picture);
}

TEST_F(SimulateCamera, PicturesOfOtherSettingsAreNotMixedIn) {
  simulate(config);
  SimulationConfig steady = config;
  steady.changing_light = false;
  EXPECT_THROW(simulate(steady), UsageError);
  config.camera = false;
  EXPECT_THROW(simulate(config), UsageError);
  config.overwrite = true;
  simulate(config);
  EXPECT_FALSE(fs::exists(image_path(0)));
  EXPECT_THROW(simulate(steady), UsageError);
}

TEST_F(SimulateCamera, CalibrationIsThatOfThePictures) {
  write_file(dir / "poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 1\n");
  const std::string Tr = "Tr: 0 -1 0 0.1 0 0 -1 -0.2 1 0 0 -0.3\n";
  write_file(dir / "calib.txt",
             "P0: 700 0 600 0 0 700 180 0 0 0 1 0\nP2: 700 0 600 50 0 700 180 1 0 0 1 2\n" + Tr);
  config.output = dir / "out";
  config.poses = dir / "poses.txt";
  config.calibration = dir / "calib.txt";
  config.last_frame.reset();
  config.image_scale = 0.5;
  simulate(config);
  const fs::path written = dir / "out/sequences/00/calib.txt";
  // The middle of pixel c is (c + 0.5) / 2 - 0.5 at half the size: 600 -> 299.75, 180 -> 89.75.
  Eigen::Matrix<double, 3, 4> P0, P2;
  P0 << 350, 0, 299.75, 0, 0, 350, 89.75, 0, 0, 0, 1, 0;
  P2 << 350, 0, 299.75, 25 - 0.5, 0, 350, 89.75, 0.5 - 0.5, 0, 0, 1, 2;
  EXPECT_TRUE(read_kitti_projection(written, "P0").isApprox(P0));
  EXPECT_TRUE(read_kitti_projection(written, "P2").isApprox(P2));
  EXPECT_HAS(read_file(written), Tr) << "as it was";
  EXPECT_EQ(read_gray_png(dir / "out/sequences/00/image_0/000001.png").width, 621);

  write_file(dir / "calib.txt", Tr);
  config.output = dir / "other";
  EXPECT_THROW(simulate(config), InputError) << "pictures need P0";
}

}  // namespace
}  // namespace revisit
