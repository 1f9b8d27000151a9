#include "lidar.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/recognition/range_image.h"
#include "testing.h"

namespace revisit {
namespace {

/// Evenly spaced from `top` to `bottom` [deg], 10 m away.
PointCloud beams(int count, double top, double bottom, int azimuths) {
  PointCloud cloud;
  for (int beam = 0; beam < count; ++beam) {
    const double elevation = (top - (top - bottom) * beam / (count - 1)) * kDegree;
    for (int k = 0; k < azimuths; ++k) {
      const double azimuth = std::numbers::pi - (k + 0.5) * 2 * std::numbers::pi / azimuths;
      cloud.points.push_back({static_cast<float>(10 * std::cos(elevation) * std::cos(azimuth)),
                              static_cast<float>(10 * std::cos(elevation) * std::sin(azimuth)),
                              static_cast<float>(10 * std::sin(elevation)), 0});
    }
  }
  return cloud;
}

std::set<int> rows_of(const RangeImage& image) {
  std::set<int> rows;
  for (int row = 0; row < image.height; ++row)
    for (int column = 0; column < image.width; ++column)
      if (image.at(row, column) != 0) rows.insert(row);
  return rows;
}

TEST(Sensors, AreValidAndOfOneSize) {
  EXPECT_EQ(sensor_names(),
            (std::vector<std::string>{"hdl64", "hdl32", "vlp16", "ouster-os0-32", "ouster-os0-64",
                                      "ouster-os0-128", "ouster-os1-64", "ouster-os1-64-gen1",
                                      "ouster-os1-128", "ouster-os2-64", "ouster-os2-128",
                                      "pandar64", "pandar-xt32", "livox-mid360"}));
  for (const Sensor& sensor : sensors()) {
    const ImageGeometry g = sensor_geometry(sensor.name);
    EXPECT_NO_THROW(check_geometry(g)) << sensor.name;
    EXPECT_EQ(g.width, 4000);
    EXPECT_EQ(g.height, 112);
    EXPECT_GT(g.elevation_top, sensor.top) << sensor.name;
    EXPECT_LT(g.elevation_bottom, sensor.bottom) << sensor.name;
  }
  expect_error<UsageError>([] { sensor_geometry("hdl46"); }, {"did you mean 'hdl64'"});
}

TEST(Sensors, TheFirstThreeHaveTheImagesTheyAlwaysHad) {
  struct Image {
    const char* sensor;
    double top, bottom;
    int closing_width, closing_height;
  };
  for (const Image& is : {Image{"hdl64", 3, -25, 5, 3}, Image{"hdl32", 34.0 / 3, -94.0 / 3, 5, 5},
                          Image{"vlp16", 16, -16, 5, 9}}) {
    const ImageGeometry g = sensor_geometry(is.sensor);
    EXPECT_EQ(g.elevation_top, is.top) << is.sensor;
    EXPECT_EQ(g.elevation_bottom, is.bottom) << is.sensor;
    EXPECT_EQ(g.max_range, 80) << is.sensor;
    EXPECT_EQ(closing_rectangle(g)[0], is.closing_width) << is.sensor;
    EXPECT_EQ(closing_rectangle(g)[1], is.closing_height) << is.sensor;
  }
  EXPECT_EQ(sensor_geometry("hdl64").closing_width, ImageGeometry().closing_width);
  EXPECT_EQ(sensor_geometry("hdl64").closing_height, ImageGeometry().closing_height);
}

TEST(Sensors, NoBeamIsOutsideAndClosingLeavesNoEmptyRowBetweenTwo) {
  for (const Sensor& sensor : sensors()) {
    if (!sensor.beams || sensor.name == "pandar64") continue;  // whose beams are not even
    for (const int height : {112, 224, 400}) {
      ImageGeometry g = sensor.image;
      g.width = 5;
      g.height = height;
      RangeImage image;
      const PointCloud cloud = beams(sensor.beams, sensor.top, sensor.bottom, g.width);
      project_rotated(cloud, Eigen::Matrix3f::Identity(), g, image);
      EXPECT_EQ(image.outside, 0) << sensor.name;
      const std::set<int> rows = rows_of(image), closed = rows_of(close_holes(image, g));
      EXPECT_EQ(*closed.rbegin() - *closed.begin() + 1, static_cast<int>(closed.size()))
          << sensor.name << ", " << height << " rows";
      if (height == 112 && sensor.beams <= 32) {
        EXPECT_EQ(rows.size(), static_cast<size_t>(sensor.beams)) << sensor.name;
      }
    }
  }
}

/// Pitches the cloud: forward becomes down.
PointCloud tilted(PointCloud cloud, double degrees) {
  const auto c = static_cast<float>(std::cos(degrees * kDegree));
  const auto s = static_cast<float>(std::sin(degrees * kDegree));
  for (Point& p : cloud.points) p = {c * p.x + s * p.z, p.y, c * p.z - s * p.x, 0};
  return cloud;
}

PointCloud shuffled(PointCloud cloud) {
  std::mt19937 random(3);
  std::shuffle(cloud.points.begin(), cloud.points.end(), random);
  return cloud;
}

TEST(FindSensor, KnowsEverySensorByItsBeamsInAnyOrder) {
  for (const Sensor& sensor : sensors()) {
    if (!sensor.beams) continue;
    const PointCloud cloud = beams(sensor.beams, sensor.top, sensor.bottom, 360);
    for (const PointCloud& scan : {cloud, shuffled(cloud)}) {
      const SensorFound found = find_sensor({scan, scan});
      EXPECT_EQ(found.name, sensor.name);
      EXPECT_EQ(found.elevations.size(), static_cast<size_t>(sensor.beams)) << sensor.name;
      EXPECT_NEAR(found.elevations.front(), sensor.top, 0.03);
      EXPECT_NEAR(found.elevations.back(), sensor.bottom, 0.03);
      EXPECT_EQ(found.inside, 1);
    }
  }
}

TEST(FindSensor, MissingNearAndStrayPointsDoNotMatter) {
  PointCloud cloud = beams(128, 22.5, -22.5, 360);
  std::erase_if(cloud.points, [](const Point& p) { return p.z > 2; });  // nothing but sky there
  std::mt19937 random(1);
  for (size_t i = 0; i < cloud.points.size(); i += 20) {
    Point& p = cloud.points[i];
    const auto kind = random() % 3;
    p = kind == 0   ? Point{}
        : kind == 1 ? Point{std::nanf(""), 1, 1, 0}
                    : Point{0.05F * p.x, 0.05F * p.y, 0.05F * p.z + 0.04F, 0};  // the vehicle
  }
  for (int i = 0; i < 50; ++i)
    cloud.points.push_back(
        {9, static_cast<float>(i), 0.1F * static_cast<float>(random() % 100), 0});
  const SensorFound found = find_sensor({cloud});
  EXPECT_EQ(found.name, "ouster-os1-128");
  EXPECT_LT(found.elevations.size(), 100U);
}

TEST(FindSensor, ATiltedSensorIsKnownByTheOrderOfItsPoints) {
  const PointCloud cloud = tilted(beams(64, 2, -24.8, 720), 0.8);
  EXPECT_EQ(find_sensor({cloud}).name, "hdl64");
  EXPECT_EQ(find_sensor({cloud}).elevations.size(), 64U);
  // The 99 % range of elevations has another order.
  EXPECT_TRUE(find_sensor({shuffled(cloud)}).elevations.empty());
  EXPECT_EQ(find_sensor({shuffled(cloud)}).name, "hdl64");
}

TEST(FindSensor, UnknownSensorsHaveAGeometryOfTheirOwn) {
  for (const PointCloud& scan :
       {beams(40, 7, -16, 360), tilted(beams(64, 2, -24.8, 720), 15), beams(10, -50, -80, 36),
        shuffled(tilted(beams(16, 15, -15, 720), 20)), PointCloud{{{1, 0, 0, 0}}}}) {
    const SensorFound found = find_sensor({scan});
    EXPECT_EQ(found.name, "");
    EXPECT_GE(found.inside, 0.99);
    EXPECT_NO_THROW(check_geometry(found.image));
  }
  SensorFound found = find_sensor({beams(40, 7, -16, 360)});
  EXPECT_EQ(found.image.elevation_top, 7.5);
  EXPECT_EQ(found.image.elevation_bottom, -16.5);
  found.image.width = 5;
  const std::set<int> rows =
      rows_of(close_holes(project(beams(40, 7, -16, 5), found.image), found.image));
  EXPECT_EQ(*rows.rbegin() - *rows.begin() + 1, static_cast<int>(rows.size()));
  EXPECT_NO_THROW(check_geometry(find_sensor({}).image));
}

TEST(FindSensor, RealScans) {
  REVISIT_NEED_SHARED(kitti, "data/kitti/sequences/00/velodyne");
  REVISIT_NEED_SHARED(others, "data/other_lidars");
  for (const auto& entry : std::filesystem::directory_iterator(kitti)) {
    const SensorFound found = find_sensor({read_scan(entry.path())});
    EXPECT_EQ(found.name, "hdl64") << entry.path();
    EXPECT_EQ(found.elevations.size(), 64U) << entry.path();
  }
  EXPECT_EQ(find_sensor({read_scan(others / "hdl64_binary_compressed.pcd")}).name, "hdl64");
  EXPECT_EQ(find_sensor({read_scan(others / "hdl32_with_origin_points.pcd")}).name, "hdl32");
  EXPECT_EQ(find_sensor({read_scan(others / "vlp16_like_with_nan.pcd")}).name, "vlp16");
}

TEST(FindSensor, SimulatedSensors) {
  using simulation::beam_pattern;
  for (const char* const name : {"hdl64", "hdl32", "vlp16", "ouster-os0-32", "ouster-os1-64"}) {
    PointCloud cloud;
    for (const double elevation : beam_pattern(name).elevation)
      for (int k = 0; k < 360; ++k)
        cloud.points.push_back({static_cast<float>(20 * std::cos(k * kDegree)),
                                static_cast<float>(20 * std::sin(k * kDegree)),
                                static_cast<float>(20 * std::tan(elevation)), 0});
    EXPECT_EQ(find_sensor({cloud}).name, name);
  }
}

}  // namespace
}  // namespace revisit
