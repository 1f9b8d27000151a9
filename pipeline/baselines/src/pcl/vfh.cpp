#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "pcl/surface.h"
#include "revisit/base/error.h"
#include "revisit/baselines/pcl_features.h"

// Reimplemented, because pcl::VFHEstimation needs libpcl_features (CMakeLists.txt).

namespace revisit {
namespace {

using Eigen::Vector3f;

// Layout of pcl::VFHSignature308: three angles, distances (which PCL leaves empty), viewpoint.
constexpr int kAngleBins = 45, kViewpointBins = 128;
constexpr int kViewpointStart = 4 * kAngleBins, kDim = kViewpointStart + kViewpointBins;
constexpr float kTotal = 100;  // sum of each histogram

struct Angles {
  float theta, alpha, phi;
};

/// Angles between the normals n and m of the points p and q, in the frame (u, v, w) of the point
/// whose normal is nearer to the connecting line (Rusu, Blodow, Beetz: Fast Point Feature
/// Histograms, ICRA 2009, eq. 1); nothing if there is no such frame.
std::optional<Angles> pair_angles(const Vector3f& p, const Vector3f& n, const Vector3f& q,
                                  const Vector3f& m) {
  const Vector3f line = q - p;
  const float length = line.norm();
  if (length == 0) return std::nullopt;
  const float slope_n = n.dot(line) / length, slope_m = m.dot(line) / length;
  const bool swap = std::acos(std::abs(slope_n)) > std::acos(std::abs(slope_m));
  const Vector3f& u = swap ? m : n;
  const Vector3f& other = swap ? n : m;
  const Vector3f across = (swap ? Vector3f(-line) : line).cross(u);
  if (across.norm() == 0) return std::nullopt;
  const Vector3f v = across.normalized(), w = u.cross(v);
  return Angles{std::atan2(w.dot(other), u.dot(other)), v.dot(other), swap ? -slope_m : slope_n};
}

/// Bin of a value from -pi to pi; cosines use the middle third.
int angle_bin(float value) {
  constexpr float kTurn = 2 * std::numbers::pi_v<float>;
  const auto bin =
      static_cast<int>(std::floor(kAngleBins * (value + std::numbers::pi_v<float>) / kTurn));
  return std::clamp(bin, 0, kAngleBins - 1);
}

void viewpoint_feature_histogram(const Surface& surface, std::span<float> feature) {
  const size_t n = surface.points->size();
  Eigen::Vector3d point_sum = Eigen::Vector3d::Zero(), normal_sum = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < n; ++i) {
    point_sum += (*surface.points)[i].getVector3fMap().cast<double>();
    normal_sum += (*surface.normals)[i].getNormalVector3fMap().cast<double>();
  }
  const Vector3f centroid = (point_sum / static_cast<double>(n)).cast<float>();
  const Vector3f mean_normal = (normal_sum / static_cast<double>(n)).cast<float>();
  // PCL includes its homogeneous coordinate, 1, in the norm; the paper's results are PCL's.
  const Vector3f to_sensor = -centroid / std::sqrt(centroid.squaredNorm() + 1);

  const float pair_share = kTotal / static_cast<float>(n - 1);
  const float share = kTotal / static_cast<float>(n);
  for (size_t i = 0; i < n; ++i) {
    const Vector3f normal = (*surface.normals)[i].getNormalVector3fMap();
    const Vector3f point = (*surface.points)[i].getVector3fMap();
    if (const auto angles = pair_angles(centroid, mean_normal, point, normal)) {
      const float values[] = {angles->theta, angles->alpha, angles->phi};
      for (int a = 0; a < 3; ++a)
        feature[static_cast<size_t>(a) * kAngleBins + static_cast<size_t>(angle_bin(values[a]))] +=
            pair_share;
    }
    const auto bin = static_cast<int>(std::floor((normal.dot(to_sensor) + 1) / 2 * kViewpointBins));
    feature[kViewpointStart + static_cast<size_t>(std::clamp(bin, 0, kViewpointBins - 1))] += share;
  }
}

}  // namespace

FeatureExtractor vfh_features(const VfhOptions& options) {
  check_radius("VFH, normals", options.normal_radius);
  FeatureExtractor extractor;
  extractor.name = "vfh";
  extractor.dim = kDim;
  extractor.key = str("vfh normals ", options.normal_radius);
  extractor.make = [options]() -> FeatureFunction<PointCloud> {
    return [options](const PointCloud& cloud, std::span<float> feature) {
      std::fill(feature.begin(), feature.end(), 0.0F);
      const Surface surface = surface_of(cloud, options.normal_radius, options.normal_radius);
      if (surface.points->size() >= 2) viewpoint_feature_histogram(surface, feature);
    };
  };
  return extractor;
}

}  // namespace revisit
