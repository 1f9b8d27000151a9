#include "project/panorama.h"
#include "revisit/recognition/range_image.h"

namespace revisit {

Projected project_rotated(const PointCloud& cloud, const Eigen::Matrix3f& R_image_sensor,
                          const ImageGeometry& geometry, RangeImage& image) {
  check_geometry(geometry);
  image.width = geometry.width;
  image.height = geometry.height;
  image.pixels.assign(static_cast<size_t>(geometry.width) * static_cast<size_t>(geometry.height),
                      0);
  const Eigen::Matrix<float, 3, 3, Eigen::RowMajor> R = R_image_sensor;
  return project_points(as_floats(cloud), cloud.points.size(), R.data(), Panorama(geometry),
                        image.pixels.data());
}

RangeImage project(const PointCloud& cloud, const ImageGeometry& geometry) {
  RangeImage image;
  project_rotated(cloud, Eigen::Matrix3f::Identity(), geometry, image);
  return image;
}

}  // namespace revisit
