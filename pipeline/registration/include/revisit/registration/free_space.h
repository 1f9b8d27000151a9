#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "revisit/recognition/point_cloud.h"
#include "revisit/registration/registration.h"

namespace revisit {

/// Points of a scan that stand upright (walls, trunks, cars), and the space before them that its
/// rays proved to be free. All lengths have the scale of the scene, because indoors places differ
/// by less. Copies share their data. Immutable, so several threads may use it at once.
class FreeSpace {
 public:
  /// `prepared` is the same scan. `options`: those of `prepared`, with the voxel size for scenes of
  /// scale 1.
  FreeSpace(const PointCloud& cloud, const PreparedScan& prepared,
            const RegistrationOptions& options = {});
  double scale() const;  ///< scene_scale()
  /// Number of upright points with the voxel size of scale 1. Few: something near hides the scene.
  int64_t upright() const;

  struct Parts;
  const Parts& parts() const { return *parts_; }  ///< for contradiction()

 private:
  std::shared_ptr<const Parts> parts_;
};

/// Upright points of a scan in another scan. Points that are hidden from the other scan, outside of
/// its view or near a surface count as neither.
struct Contradiction {
  int64_t confirmed = 0;     ///< the other has a point within 0.3 m times the scale
  int64_t contradicted = 0;  ///< these float in the free space of the other
  /// (contradicted + prior / 2) / (confirmed + contradicted + prior). Scans of one place have some
  /// 0.01 to 0.15; other places that look alike have more.
  double fraction(double prior) const;
};

/// Counts the points of `scan` in the free space of `other`. The counts do not depend on the CPU.
Contradiction contradiction(const FreeSpace& scan, const FreeSpace& other,
                            const Eigen::Isometry3d& T_other_scan);

/// Another scan, and T_other_scan.
using PlacedSpace = std::pair<FreeSpace, Eigen::Isometry3d>;

/// Points of `cloud`, of which `scan` was made, without things that moved: points that float in the
/// free space of at least two of the `others`, and of a quarter of those that show them.
PointCloud standing_points(const PointCloud& cloud, const FreeSpace& scan,
                           const std::vector<PlacedSpace>& others);

/// Sum over both directions, with the prior 10.
double mutual_contradiction(const FreeSpace& query, const FreeSpace& place,
                            const Eigen::Isometry3d& T_place_query);

}  // namespace revisit
