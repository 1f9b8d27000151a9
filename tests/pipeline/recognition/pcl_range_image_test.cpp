// project() against PCL's RangeImageSpherical, the range image of the paper, at equal resolution.
// The two agree but for these differences of PCL's:
//
//  - PCL rounds to the nearest pixel where we take the one below: its pixel centers are our pixel
//    corners. Half a pixel of yaw and of elevation compensates for it.
//  - PCL takes angles from tables of 20001 entries, which are wrong by up to 5e-5 rad, that is 0.03
//    columns or 0.013 rows of the HDL-64 geometry: points so near a border may fall into the next
//    pixel. That changes 0.4 % of a scan's pixels.
//  - PCL also gives a return to those of its (up to) three nearest other pixels that have none of
//    their own. We leave them to hole closing.
//  - PCL drops what lies within half a column to the right of backwards; we wrap around.
#include "testing.h"

#ifdef REVISIT_HAVE_PCL

#include <pcl/point_types.h>
#include <pcl/range_image/range_image_spherical.h>

#include <Eigen/Geometry>

#include "naive_range_image.h"
#include "revisit/datasets/scan_file.h"

namespace revisit {
namespace {

constexpr double kColumn = 2 * kPi / 4000, kRow = kPi / 720;
constexpr int kRowsAbove = 348;  // PCL's image is the whole sphere: its rows above ours

pcl::RangeImageSpherical pcl_image(const PointCloud& cloud) {
  pcl::PointCloud<pcl::PointXYZ> points;
  for (const Point& p : cloud.points) points.push_back({p.x, p.y, p.z});
  pcl::RangeImageSpherical image;
  constexpr int kNoCropping = std::numeric_limits<int>::min();
  image.createFromPointCloud(points, static_cast<float>(kColumn), static_cast<float>(kRow),
                             static_cast<float>(2 * kPi), static_cast<float>(kPi),
                             Eigen::Affine3f::Identity(), pcl::RangeImage::LASER_FRAME, 0, 0,
                             kNoCropping);
  return image;
}

/// Ranges [m] in place of pixel values.
RangeImage our_image(const PointCloud& cloud) {
  const ImageGeometry g{.elevation_top = 3.125, .elevation_bottom = -24.875, .max_range = 255};
  const Eigen::Matrix3f half_a_column(
      Eigen::AngleAxisf(static_cast<float>(-kColumn / 2), Eigen::Vector3f::UnitZ()));
  RangeImage image;
  project_rotated(cloud, half_a_column, g, image);
  return image;
}

/// Range [m]; 0 for none.
float range_at(const pcl::RangeImageSpherical& image, int row, int column) {
  const float range = image.at(column, row + kRowsAbove).range;
  return std::isinf(range) ? 0 : range;
}

bool near(double value, double margin) {  // a border: half way between whole numbers
  return std::abs(value - std::floor(value) - 0.5) < margin;
}

/// Drops points that the tables or the seam affect.
PointCloud away_from_borders(const PointCloud& cloud) {
  PointCloud kept;
  for (const Point& p : cloud.points) {
    const double column = (kPi - std::atan2(p.y, p.x)) / kColumn;
    const double row = (kPi / 2 - std::atan2(p.z, std::hypot(p.x, p.y))) / kRow;
    if (!near(column, 0.05) && !near(row, 0.02) && column < 3999.5) kept.points.push_back(p);
  }
  return kept;
}

struct ImageComparison {
  int returns = 0;       // pixels of ours with a return
  int different = 0;     // of them, PCL has another range
  int next_to_them = 0;  // pixels only PCL fills, beside one of the returns
  int elsewhere = 0;     // and not beside one
};
ImageComparison compare(const PointCloud& cloud) {
  const RangeImage ours = our_image(cloud);
  const pcl::RangeImageSpherical theirs = pcl_image(cloud);
  EXPECT_EQ(theirs.width, 4000U);
  ImageComparison result;
  for (int row = 0; row < ours.height; ++row)
    for (int column = 0; column < ours.width; ++column) {
      const float range = range_at(theirs, row, column);
      if (ours.at(row, column) != 0) {
        ++result.returns;
        result.different += std::abs(ours.at(row, column) - range) > 1e-6F * range;
      } else if (range != 0) {
        bool beside = row == 0 || row == ours.height - 1;  // neighbors may be outside of our image
        for (const int dr : {-1, 0, 1})
          for (const int dc : {-1, 0, 1})
            beside = beside || ours.at(row + dr, (column + dc + 4000) % 4000) != 0;
        ++(beside ? result.next_to_them : result.elsewhere);
      }
    }
  return result;
}

TEST(PclRangeImage, TheSamePixelsAndRangesAwayFromBorders) {
  REVISIT_NEED_SHARED(file, "data/kitti/sequences/00/velodyne/000052.bin");
  const PointCloud scan = read_scan(file), kept = away_from_borders(scan);
  EXPECT_GT(kept.points.size(), scan.points.size() * 8 / 10);
  const ImageComparison result = compare(kept);
  EXPECT_GT(result.returns, 90000);
  EXPECT_EQ(result.different, 0);
  EXPECT_EQ(result.elsewhere, 0);
  EXPECT_GT(result.next_to_them, result.returns) << "PCL fills neighbors";
}

TEST(PclRangeImage, RandomClouds) {
  PointCloud cloud = random_cloud(12, 50000);
  for (Point& p : cloud.points) p.z *= 0.3F;
  const ImageComparison result = compare(away_from_borders(cloud));
  EXPECT_GT(result.returns, 20000);
  EXPECT_EQ(result.different, 0);
  EXPECT_EQ(result.elsewhere, 0);
}

}  // namespace
}  // namespace revisit

#else

TEST(PclRangeImage, Compared) {
  GTEST_SKIP() << "PCL was not found when the tests were built";
}

#endif
