#include <pcl/console/print.h>
#include <pcl/features/feature.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>
#include <pcl/features/impl/feature.hpp>
#include <pcl/features/impl/grsd.hpp>
#include <pcl/features/impl/normal_3d.hpp>
#include <pcl/features/impl/rsd.hpp>
#include <unordered_map>

#include "point_features.h"
#include "revisit/base/error.h"
#include "revisit/baselines/baselines.h"

namespace revisit {
namespace {

using Voxel = std::array<int32_t, 3>;
using Points = pcl::PointCloud<pcl::PointXYZ>;

constexpr double kMinRadius = 0.001, kMaxRadius = 10;  // [m]

/// Points and as many surface normals, oriented toward the sensor.
struct Surface {
  Points::Ptr points;
  pcl::PointCloud<pcl::Normal>::Ptr normals;
};
/// `edge` must be at least kMinRadius, so that indices fit in 21 bits.
Voxel voxel_of(const pcl::PointXYZ& point, float edge) {
  const float inverse = 1 / edge;  // as pcl::VoxelGrid computes it
  return {static_cast<int32_t>(std::floor(point.x * inverse)),
          static_cast<int32_t>(std::floor(point.y * inverse)),
          static_cast<int32_t>(std::floor(point.z * inverse))};
}

uint64_t voxel_key(const Voxel& voxel) {
  uint64_t key = 0;
  for (const int32_t index : voxel) key = key << 21 | (static_cast<uint64_t>(index) & 0x1FFFFF);
  return key;
}

/// Bounds the work by the number of pairs of points in a voxel of edge `radius`.
void check_density(const Points& points, double radius) {
  constexpr double kMaxPairs = 1e9;  // a scan of an HDL-64 has a few million
  std::unordered_map<uint64_t, double> counts;
  const auto edge = static_cast<float>(radius);
  for (const pcl::PointXYZ& point : points) ++counts[voxel_key(voxel_of(point, edge))];
  double pairs = 0;
  for (const auto& [key, count] : counts) pairs += count * count;
  if (pairs > kMaxPairs)
    throw InputError("the points are too dense for a neighborhood of ", radius,
                     " m: ", points.size(), " points, ", pairs,
                     " pairs of neighbors; downsample the scan or use a smaller radius");
}

void check_radius(const char* what, double radius) {
  if (!(radius >= kMinRadius && radius <= kMaxRadius))
    throw UsageError(what, ": expected a radius of ", kMinRadius, " to ", kMaxRadius, " m, found ",
                     radius);
}

/// Points with at least 3 points within `radius`, including themselves. Throws InputError for a
/// scan so dense that its neighborhoods, up to the caller's `largest_radius`, would take hours.
Surface surface_of(const PointCloud& cloud, double radius, double largest_radius) {
  // Errors are reported as exceptions instead.
  [[maybe_unused]] static const bool silent = [] {
    pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
    return true;
  }();
  const Points::Ptr points = to_pcl<Points>(cloud);
  check_density(*points, largest_radius);
  pcl::PointCloud<pcl::Normal> normals;
  pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
  estimation.setInputCloud(points);
  estimation.setSearchMethod(pcl::search::KdTree<pcl::PointXYZ>::Ptr(
      new pcl::search::KdTree<pcl::PointXYZ>(/*sorted=*/false)));
  estimation.setRadiusSearch(radius);
  if (!points->empty()) estimation.compute(normals);

  Surface surface{Points::Ptr(new Points),
                  pcl::PointCloud<pcl::Normal>::Ptr(new pcl::PointCloud<pcl::Normal>)};
  for (size_t i = 0; i < normals.size(); ++i) {
    const pcl::Normal& normal = normals[i];
    if (!std::isfinite(normal.normal_x + normal.normal_y + normal.normal_z)) continue;
    surface.points->push_back((*points)[i]);
    surface.normals->push_back(normal);
  }
  return surface;
}

// VFH is reimplemented, because pcl::VFHEstimation needs libpcl_features (CMakeLists.txt).

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

// pcl::GRSDEstimation allocates voxels for the whole extent, 3 GB for 160 m at 0.1 m, and reads out
// of bounds beyond 2^31. This is the same algorithm on the occupied voxels only.

using Grsd = pcl::GRSDEstimation<pcl::PointXYZ, pcl::Normal, pcl::GRSDSignature21>;

constexpr int kClasses = 5;  // without the class of empty voxels

struct Voxels {
  Points::Ptr centroids{new Points};
  std::vector<Voxel> places;
  std::unordered_map<uint64_t, size_t> rows;  // voxel key -> row in both
};

Voxels occupied_voxels(const Points& points, float edge) {
  Voxels voxels;
  std::vector<float> counts;
  for (const pcl::PointXYZ& point : points) {
    const Voxel place = voxel_of(point, edge);
    const auto [at, is_new] = voxels.rows.emplace(voxel_key(place), voxels.places.size());
    if (is_new) {
      voxels.places.push_back(place);
      voxels.centroids->push_back({0, 0, 0});
      counts.push_back(0);
    }
    (*voxels.centroids)[at->second].getVector3fMap() += point.getVector3fMap();
    ++counts[at->second];
  }
  for (size_t i = 0; i < counts.size(); ++i) (*voxels.centroids)[i].getVector3fMap() /= counts[i];
  return voxels;
}

std::vector<int> surface_classes(const Voxels& voxels, const Surface& surface, double radius) {
  pcl::RSDEstimation<pcl::PointXYZ, pcl::Normal, pcl::PrincipalRadiiRSD> estimation;
  estimation.setInputCloud(voxels.centroids);
  estimation.setSearchSurface(surface.points);
  estimation.setInputNormals(surface.normals);
  estimation.setRadiusSearch(radius);
  pcl::PointCloud<pcl::PrincipalRadiiRSD> radii;
  estimation.compute(radii);
  std::vector<int> classes;
  for (const pcl::PrincipalRadiiRSD& r : radii)
    classes.push_back(Grsd::getSimpleType(r.r_min, r.r_max));
  return classes;
}

void count_transitions(const Voxels& voxels, const std::vector<int>& classes,
                       std::span<float> feature) {
  std::array<std::array<int, kClasses + 1>, kClasses + 1> transitions{};
  for (size_t i = 0; i < classes.size(); ++i)
    for (int dx = -1; dx <= 1; ++dx)
      for (int dy = -1; dy <= 1; ++dy)
        for (int dz = -1; dz <= 1; ++dz) {
          if (dx == 0 && dy == 0 && dz == 0) continue;
          const Voxel& place = voxels.places[i];
          const auto at =
              voxels.rows.find(voxel_key({place[0] + dx, place[1] + dy, place[2] + dz}));
          const int neighbor = at == voxels.rows.end() ? kClasses : classes[at->second];
          ++transitions[static_cast<size_t>(classes[i])][static_cast<size_t>(neighbor)];
        }
  auto out = feature.begin();
  for (size_t a = 0; a <= kClasses; ++a)
    for (size_t b = a; b <= kClasses; ++b)
      *out++ = static_cast<float>(transitions[a][b] + transitions[b][a]);
}

}  // namespace

FeatureExtractor vfh_features(double normal_radius) {
  check_radius("VFH, normals", normal_radius);
  const auto make = [=]() -> FeatureFunction<PointCloud> {
    return [=](const PointCloud& cloud, std::span<float> feature) {
      std::fill(feature.begin(), feature.end(), 0.0F);
      const Surface surface = surface_of(cloud, normal_radius, normal_radius);
      if (surface.points->size() >= 2) viewpoint_feature_histogram(surface, feature);
    };
  };
  return {.name = "vfh", .key = str("vfh normals ", normal_radius), .dim = kDim, .make = make};
}

FeatureExtractor grsd_features(double normal_radius, double radius) {
  check_radius("GRSD, normals", normal_radius);
  check_radius("GRSD", radius);
  const auto make = [=]() -> FeatureFunction<PointCloud> {
    return [=](const PointCloud& cloud, std::span<float> feature) {
      std::fill(feature.begin(), feature.end(), 0.0F);
      const Surface surface = surface_of(cloud, normal_radius, std::max(normal_radius, radius));
      if (surface.points->empty()) return;
      const Voxels voxels = occupied_voxels(*surface.points, static_cast<float>(radius));
      count_transitions(voxels, surface_classes(voxels, surface, radius), feature);
    };
  };
  return {.name = "grsd",
          .key = str("grsd normals ", normal_radius, " radius ", radius),
          .dim = pcl::GRSDSignature21::descriptorSize(),
          .make = make};
}

}  // namespace revisit
