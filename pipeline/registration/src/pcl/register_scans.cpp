#include <pcl/console/print.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/registration/gicp.h>

#include <vector>

#include "revisit/registration/registration.h"

namespace revisit::pipeline {
namespace {

using Points = pcl::PointCloud<pcl::PointXYZ>;
using Gicp = pcl::GeneralizedIterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ>;
/// As PCL's GICP takes them.
using Covariances = std::vector<Eigen::Matrix3d, Eigen::aligned_allocator<Eigen::Matrix3d>>;

/// PCL minimises by BFGS, which stops short where a metre changes the sum much less than a radian
/// does. With lengths in units of 20 m, as far as points are away, both change it alike.
constexpr double kUnit = 20;

Points::Ptr points_of(const PreparedScan& scan) {
  const Points::Ptr points(new Points);
  points->reserve(scan.points().size());
  for (const Eigen::Vector3f& metres : scan.points()) {
    const Eigen::Vector3f p = metres / static_cast<float>(kUnit);
    points->push_back({p.x(), p.y(), p.z()});
  }
  return points;
}

/// Flat along the normals, as in the GICP paper.
pcl::shared_ptr<Covariances> covariances_of(const PreparedScan& scan) {
  constexpr double kFlatness = 1e-3;
  const auto covariances = pcl::make_shared<Covariances>();
  covariances->reserve(scan.normals().size());
  for (const Eigen::Vector3f& normal : scan.normals()) {
    const Eigen::Vector3d n = normal.cast<double>();
    covariances->push_back(Eigen::Matrix3d::Identity() - (1 - kFlatness) * n * n.transpose());
  }
  return covariances;
}

Eigen::Isometry3d refined(const PreparedScan& query, const PreparedScan& place,
                          const Eigen::Isometry3d& start, double max_distance) {
  // PCL prints its complaints; a registration that failed has no inliers.
  [[maybe_unused]] static const bool silent = [] {
    pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
    return true;
  }();
  Gicp gicp;
  gicp.setInputSource(points_of(query));
  gicp.setInputTarget(points_of(place));
  gicp.setSourceCovariances(covariances_of(query));
  gicp.setTargetCovariances(covariances_of(place));
  gicp.setMaxCorrespondenceDistance(max_distance / kUnit);
  gicp.setMaximumIterations(20);
  gicp.setTransformationEpsilon(1e-3 / kUnit);
  gicp.setRotationEpsilon(1e-4);
  gicp.setTranslationGradientTolerance(1e-4);
  gicp.setRotationGradientTolerance(1e-4);
  Eigen::Isometry3d in_units = start;
  in_units.translation() /= kUnit;
  Points moved;
  gicp.align(moved, in_units.matrix().cast<float>());
  Eigen::Isometry3d found(gicp.getFinalTransformation().cast<double>());
  found.translation() *= kUnit;
  return found;
}

}  // namespace

Registration register_scans(const PreparedScan& query, const PreparedScan& place, double turn,
                            const RegistrationOptions& options) {
  return register_scans(query, place, turn, options, [&](const Eigen::Isometry3d& start) {
    return refined(query, place, start, options.max_distance);
  });
}

}  // namespace revisit::pipeline
