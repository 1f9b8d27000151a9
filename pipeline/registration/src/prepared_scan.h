#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstdint>
#include <nanoflann.hpp>
#include <optional>
#include <span>
#include <vector>

#include "revisit/registration/registration.h"

namespace revisit {

struct Neighbor {
  float squared = 0;  // [m^2]
  uint32_t point = 0;
};

/// Queries are thread-safe.
class NearestNeighbors {
 public:
  static constexpr size_t kMost = 20;  // that are found at once

  /// `points` are not copied and must not move or change.
  explicit NearestNeighbors(const std::vector<Eigen::Vector3f>& points)
      : source_{points}, tree_(3, source_, nanoflann::KDTreeSingleIndexAdaptorParams(10)) {}
  NearestNeighbors(const NearestNeighbors&) = delete;
  NearestNeighbors& operator=(const NearestNeighbors&) = delete;

  /// Fills `found` [1 .. kMost], nearest first, with squared distances below `limit` [m^2]. Returns
  /// their number.
  size_t nearest(const Eigen::Vector3f& place, float limit, std::span<Neighbor> found) const {
    std::array<uint32_t, kMost> points;
    std::array<float, kMost> squared;
    nanoflann::KNNResultSet<float, uint32_t> results(found.size());
    results.init(points.data(), squared.data());
    squared[found.size() - 1] = limit;  // what is farther is not found
    tree_.findNeighbors(results, place.data(), {});
    for (size_t i = 0; i < results.size(); ++i) found[i] = {squared[i], points[i]};
    return results.size();
  }

  /// True if a point is nearer than a squared distance of `limit` [m^2].
  bool any_within(const Eigen::Vector3f& place, float limit) const {
    AnyWithin result{limit};
    tree_.findNeighbors(result, place.data(), {});
    return result.found;
  }

 private:
  /// nanoflann's result set that ends the search at the first point.
  struct AnyWithin {
    float limit;
    bool found = false;

    bool addPoint(float squared, uint32_t) {
      found = squared < limit;
      return !found;
    }
    float worstDist() const { return limit; }
    bool full() const { return true; }
  };

  struct Source {
    const std::vector<Eigen::Vector3f>& points;

    size_t kdtree_get_point_count() const { return points.size(); }
    float kdtree_get_pt(size_t point, size_t axis) const {
      return points[point][static_cast<Eigen::Index>(axis)];
    }
    template <class Box>
    bool kdtree_get_bbox(Box&) const {
      return false;  // nanoflann computes it
    }
  };

  Source source_;
  nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Source>, Source, 3,
                                      uint32_t>
      tree_;
};

/// With fewer points, normals and poses are meaningless.
constexpr size_t kMinPoints = 100;

/// Only `range` and `points` are set if there are fewer than kMinPoints points.
struct PreparedScan::Parts {
  double range = 0;  // [m]
  std::vector<Eigen::Vector3f> points;
  std::optional<NearestNeighbors> tree;
  std::vector<Eigen::Vector3f> normals;  // [point], of either sign
  std::vector<Eigen::Vector3f> upright;  // points with near-horizontal normals (non-ground)
};

void check(const RegistrationOptions& options);

/// Voxel means within `range` [m]. The order of the input affects only rounding.
std::vector<Eigen::Vector3f> thinned(const PointCloud& cloud, double voxel, double range);

inline bool is_non_ground(const Eigen::Vector3f& normal) {
  return std::abs(normal.z()) < 0.5F;
}

/// Planar pose T_place_query that maximizes the top-down overlap of the query with cells of the
/// place: yaw `relative_yaw` +- 3 degrees [rad], shift up to `search_radius` along x and y [m].
/// Points [m] are within `range` of their sensor.
Eigen::Isometry3d coarse_pose(const std::vector<Eigen::Vector3f>& query,
                              const std::vector<Eigen::Vector3f>& place, double relative_yaw,
                              double search_radius, double range);

}  // namespace revisit
