#include "revisit/registration/free_space.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>
#include <vector>

#include "prepared_scan.h"

namespace revisit {

// Chosen on offices, a walk and NCLT, all with one set of values. Lengths are those of scale 1.
namespace {

constexpr double kUsualRange = 16;  // median range of upright points at scale 1 [m]
constexpr double kLeastScale = 0.3;
constexpr double kNear = 0.3;        // distance of points that confirm each other [m]
constexpr double kDisc = 0.25;       // radius of the disc that a downsampled point covers [m]
constexpr double kLeastRange = 0.5;  // nearer points belong to the carrier [m]
constexpr int kColumns = 360, kRows = 120;  // cells of 1 degree; elevation -60 to 60 degrees
constexpr double kWidest = 6, kWidestAzimuth = 10;  // half width of a disc [deg]
constexpr double kDegrees = 180 / std::numbers::pi;

/// atan of 0 to 1, by its series around 0 and 45 degrees, within 1e-5 degrees [deg]. libm's differs
/// between versions and CPUs, which would move points between cells.
double acute(double tangent) {
  constexpr double kHalf = 0.41421356237309503;  // tangent of 22.5 degrees
  const bool steep = tangent > kHalf;
  const double t = steep ? (tangent - 1) / (tangent + 1) : tangent, s = t * t;
  double sum = 0;
  for (const double one : {1. / 15, 1. / 13, 1. / 11, 1. / 9, 1. / 7, 1. / 5, 1. / 3})
    sum = s * (one - sum);
  return (steep ? 45 : 0) + kDegrees * (t - t * sum);
}

/// atan2(y, x), -180 to 180 [deg].
double angle_of(double y, double x) {
  const double across = std::abs(y), along = std::abs(x);
  if (across == 0 && along == 0) return 0;
  double angle = across <= along ? acute(across / along) : 90 - acute(along / across);
  if (x < 0) angle = 180 - angle;
  return y < 0 ? -angle : angle;
}

int floor_of(double x) {
  constexpr int kPositive = 1024;  // makes x positive
  return static_cast<int>(x + kPositive) - kPositive;
}

struct Direction {
  double range = 0;                   // [m]
  double horizontal = 0;              // range in the plane [m]
  double azimuth = 0, elevation = 0;  // from the first column and row, in cells

  explicit Direction(const Eigen::Vector3d& p) {
    const double plane = p.x() * p.x() + p.y() * p.y();
    horizontal = std::sqrt(plane);
    range = std::sqrt(plane + p.z() * p.z());
    azimuth = angle_of(p.y(), p.x()) + kColumns / 2;
    elevation = angle_of(p.z(), horizontal) + kRows / 2;
  }
};

/// CellRange whose centers are within `half` of `middle`, and that of `middle`.
struct CellRange {
  int begin, end;
  CellRange(double middle, double half)
      : begin(std::min(floor_of(middle - half + 0.5), floor_of(middle))),
        end(std::max(-floor_of(0.5 - middle - half), floor_of(middle) + 1)) {}
};

/// Range of the nearest surface per direction.
class SurfaceImage {
 public:
  SurfaceImage(const std::vector<Eigen::Vector3f>& points, double disc) {
    for (const Eigen::Vector3f& point : points) {
      const Direction direction(point.cast<double>());
      if (direction.range < kLeastRange) continue;
      add(direction, disc);
    }
  }

  /// False where no surface was seen.
  bool is_before_surface(const Direction& direction, double margin) const {
    const int row = floor_of(direction.elevation);
    if (row < 0 || row >= kRows) return false;
    const float surface = ranges_[index(row, floor_of(direction.azimuth) % kColumns)];
    return surface < kNone && direction.range < static_cast<double>(surface) - margin;
  }

 private:
  static constexpr float kNone = std::numeric_limits<float>::max();

  void add(const Direction& direction, double disc) {
    const double sine = disc / direction.range;  // asin by its series: at most 0.1
    const double half =
        sine > 0.1 ? kWidest : std::min(kWidest, kDegrees * sine * (1 + sine * sine / 6));
    const double slant = std::max(0.3, direction.horizontal / direction.range);
    const CellRange rows(direction.elevation, half);
    const CellRange columns(direction.azimuth, std::min(kWidestAzimuth, half / slant));
    const auto range = static_cast<float>(direction.range);
    for (int row = std::max(0, rows.begin); row < std::min(kRows, rows.end); ++row)
      for (int column = columns.begin; column < columns.end; ++column) {
        float& nearest = ranges_[index(row, (column + kColumns) % kColumns)];
        nearest = std::min(nearest, range);
      }
  }

  static size_t index(int row, int column) {
    return static_cast<size_t>(row) * kColumns + static_cast<size_t>(column);
  }

  std::vector<float> ranges_ = std::vector<float>(kRows * kColumns, kNone);  // [row][column] [m]
};

/// Distance before a surface at which free space ends [m]. Outdoors surfaces are rougher, and
/// ranges longer.
double margin_of(double scale, double range) {
  const double t = std::clamp((scale - 0.6) / 0.4, 0.0, 1.0);
  return (0.3 + 0.2 * t) * scale + (0.01 + 0.01 * t) * range;
}

}  // namespace

double scene_scale(const PreparedScan& scan) {
  const std::vector<Eigen::Vector3f>& upright = scan.parts().upright;
  if (upright.empty()) return 1;
  std::vector<float> ranges;
  for (const Eigen::Vector3f& p : upright) ranges.push_back(p.norm());
  const auto middle = ranges.begin() + std::ssize(ranges) / 2;
  std::ranges::nth_element(ranges, middle);
  return std::clamp(static_cast<double>(*middle) / kUsualRange, kLeastScale, 1.0);
}

struct FreeSpace::Parts {
  double scale;
  int64_t upright;
  PreparedScan scan;  // with the voxel size of the scale
  SurfaceImage image;
};

FreeSpace::FreeSpace(const PointCloud& cloud, const PreparedScan& prepared,
                     const RegistrationOptions& options) {
  const double scale = scene_scale(prepared);
  RegistrationOptions scaled = options;
  scaled.voxel_size = std::max(0.05, scale * options.voxel_size);
  const PreparedScan scan = scale < 1 ? PreparedScan(cloud, scaled) : prepared;
  parts_ = std::make_shared<const Parts>(Parts{scale, std::ssize(prepared.parts().upright), scan,
                                               SurfaceImage(scan.points(), scale * kDisc)});
}

double FreeSpace::scale() const {
  return parts_->scale;
}

int64_t FreeSpace::upright() const {
  return parts_->upright;
}

double Contradiction::fraction(double prior) const {
  return (static_cast<double>(contradicted) + prior / 2) /
         (static_cast<double>(confirmed + contradicted) + prior);
}

namespace {

/// A point in the frame of a scan is before the surfaces that it saw.
bool floats(const FreeSpace::Parts& there, double scale, const Eigen::Vector3d& point) {
  const Direction direction(point);
  return there.image.is_before_surface(direction, margin_of(scale, direction.range));
}

/// What a scan shows of a point in its frame: 1 if a surface confirms it, -1 if it floats in free
/// space, 0 if neither.
int shown_by(const FreeSpace::Parts& there, double scale, const Eigen::Vector3d& point) {
  const double near = kNear * scale;
  std::array<Neighbor, 1> found;
  if (there.scan.parts().tree->nearest(point.cast<float>(), static_cast<float>(near * near), found))
    return 1;
  return floats(there, scale, point) ? -1 : 0;
}

}  // namespace

Contradiction contradiction(const FreeSpace& scan, const FreeSpace& other,
                            const Eigen::Isometry3d& T_other_scan) {
  const FreeSpace::Parts& there = other.parts();
  const double scale = std::max(scan.scale(), other.scale());
  Contradiction found;
  if (!there.scan.parts().tree) return found;
  for (const Eigen::Vector3f& point : scan.parts().scan.parts().upright) {
    const int shown = shown_by(there, scale, T_other_scan * point.cast<double>());
    found.confirmed += shown > 0 ? 1 : 0;
    found.contradicted += shown < 0 ? 1 : 0;
  }
  return found;
}

PointCloud standing_points(const PointCloud& cloud, const FreeSpace& scan,
                           const std::vector<PlacedSpace>& others) {
  constexpr int kLeast = 2;          // contradictions; one may be an error of the poses
  constexpr int kConfirmations = 3;  // that outweigh a contradiction
  const auto moves = [&](const Point& p) {
    const Eigen::Vector3d point(p.x, p.y, p.z);
    const auto each = [&](const auto& take) {
      for (const auto& [other, T_other_scan] : others)
        if (other.parts().scan.parts().tree)
          take(other.parts(), std::max(scan.scale(), other.scale()), T_other_scan * point);
    };
    int floating = 0, contradicted = 0, confirmed = 0;
    each([&](const auto&... at) { floating += floats(at...) ? 1 : 0; });
    if (floating < kLeast) return false;  // faster than the search for neighbors
    each([&](const auto&... at) {
      const int shown = shown_by(at...);
      contradicted += shown < 0 ? 1 : 0;
      confirmed += shown > 0 ? 1 : 0;
    });
    return contradicted >= kLeast && kConfirmations * contradicted >= confirmed;
  };
  PointCloud kept;
  std::ranges::remove_copy_if(cloud.points, std::back_inserter(kept.points), moves);
  return kept;
}

double mutual_contradiction(const FreeSpace& query, const FreeSpace& place,
                            const Eigen::Isometry3d& T_place_query) {
  const Contradiction there = contradiction(query, place, T_place_query);
  const Contradiction back = contradiction(place, query, T_place_query.inverse());
  return Contradiction{there.confirmed + back.confirmed, there.contradicted + back.contradicted}
      .fraction(10);
}

}  // namespace revisit
