#include "prepared_scan.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <span>

#include "revisit/base/error.h"

namespace revisit {
namespace {

void check(const char* name, double value, double least, double most) {
  if (!(value >= least && value <= most))
    throw UsageError("RegistrationOptions::", name, ": expected ", least, " to ", most, ", found ",
                     value);
}

}  // namespace

std::vector<Eigen::Vector3f> thinned(const PointCloud& cloud, double voxel, double range) {
  struct Voxel {
    uint64_t key;
    Eigen::Vector3d sum;
    double count;
  };
  const double per_meter = 1 / voxel, most = range * range;
  std::vector<Voxel> voxels;
  // Hash table with open addressing: index of a voxel plus one; 0 if empty.
  std::vector<uint32_t> table(std::bit_ceil(2 * cloud.points.size() + 2));
  const int shift = 64 - std::countr_zero(table.size());
  // Voxel of the preceding point, which is often the same.
  uint32_t current = 0;
  uint64_t current_key = ~uint64_t{0};
  for (const Point& point : cloud.points) {
    const Eigen::Vector3d p = Eigen::Vector3f(point.x, point.y, point.z).cast<double>();
    if (!is_return(point) || !(p.squaredNorm() <= most)) continue;
    uint64_t key = 0;
    for (const double x : {p.x(), p.y(), p.z()})
      key = key << 21 | static_cast<uint32_t>(static_cast<int64_t>((x + range) * per_meter));
    if (key != current_key) {
      size_t at = key * 0x9E3779B97F4A7C15 >> shift;  // high bits, which depend on all of the key
      while (table[at] != 0 && voxels[table[at] - 1].key != key) at = (at + 1) & (table.size() - 1);
      if (table[at] == 0) {
        voxels.push_back({key, Eigen::Vector3d::Zero(), 0});
        table[at] = static_cast<uint32_t>(voxels.size());
      }
      current = table[at] - 1;
      current_key = key;
    }
    voxels[current].sum += p;
    ++voxels[current].count;
  }
  std::ranges::sort(voxels, {}, &Voxel::key);

  std::vector<Eigen::Vector3f> points;
  points.reserve(voxels.size());
  for (const Voxel& v : voxels) points.emplace_back((v.sum / v.count).cast<float>());
  return points;
}

namespace {

/// Eigenvector of the smallest eigenvalue, by Newton's method from below: some steps of arithmetic,
/// where closed forms need functions whose last digits depend on the CPU.
Eigen::Vector3d thinnest_direction(const Eigen::Matrix3d& covariance) {
  constexpr int kMaxSteps = 20;
  const double size = covariance.trace();
  if (!(size > 0)) return Eigen::Vector3d::UnitX();
  Eigen::Matrix3d A = covariance / size;  // trace 1
  const Eigen::Vector3d x = A.col(0), y = A.col(1), z = A.col(2);
  const double pairs =
      x[0] * y[1] - x[1] * x[1] + x[0] * z[2] - x[2] * x[2] + y[1] * z[2] - y[2] * y[2];
  const double determinant = x.dot(y.cross(z));
  double root = 0;
  for (int i = 0; i < kMaxSteps; ++i) {
    const double slope = pairs + root * (3 * root - 2);
    const double step = (determinant - root * (pairs + root * (root - 1))) / slope;
    if (!(slope > 0 && step > 1e-12)) break;
    root += step;
  }
  A.diagonal().array() -= root;
  Eigen::Vector3d best = A.col(0).cross(A.col(1));
  for (const Eigen::Vector3d& other :
       {A.col(0).cross(A.col(2)).eval(), A.col(1).cross(A.col(2)).eval()})
    if (other.squaredNorm() > best.squaredNorm()) best = other;
  if (best.squaredNorm() > 1e-20) return best.normalized();
  Eigen::Index widest = 0;  // a line: any direction across it
  A.colwise().squaredNorm().maxCoeff(&widest);
  return A.col(widest).unitOrthogonal();
}

Eigen::Vector3f normal_of(const std::vector<Eigen::Vector3f>& points,
                          std::span<const Neighbor> neighbors) {
  // Relative to the nearest point, to limit cancellation errors.
  const Eigen::Vector3f& origin = points[neighbors[0].point];
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  for (const Neighbor& neighbor : neighbors) {
    const Eigen::Vector3d p = (points[neighbor.point] - origin).cast<double>();
    sum += p;
    squares.col(0) += p[0] * p;
    squares.col(1).tail<2>() += p[1] * p.tail<2>();
    squares(2, 2) += p[2] * p[2];
  }
  squares -= sum * sum.transpose() / static_cast<double>(neighbors.size());
  const Eigen::Matrix3d covariance = squares.selfadjointView<Eigen::Lower>();
  return thinnest_direction(covariance).cast<float>();
}

}  // namespace

void check(const RegistrationOptions& options) {
  check("voxel_size", options.voxel_size, 0.05, 5);
  check("max_range", options.max_range, 1, 200);
  check("search_radius", options.search_radius, 0, 20);
  check("max_distance", options.max_distance, 0.01, 20);
  check("inlier_distance", options.inlier_distance, 0.01, 20);
  check("min_inlier_ratio", options.min_inlier_ratio, 0, 1);
  check("min_constraint", options.min_constraint, 0, 1);
}

namespace {

constexpr double kSquare = 2.5;       // edge of the squares of the search, in voxels
constexpr double kMostSquares = 250;  // per range

}  // namespace

PreparedScan::PreparedScan(const PointCloud& cloud, const RegistrationOptions& options) {
  check(options);
  const auto parts = std::make_shared<Parts>();
  parts_ = parts;
  parts->range = options.max_range;
  parts->points = thinned(cloud, options.voxel_size, options.max_range);
  if (parts->points.size() < kMinPoints) return;

  // Larger ones for long ranges, so that there are not too many.
  const auto square =
      static_cast<float>(std::max(kSquare * options.voxel_size, options.max_range / kMostSquares));
  parts->tree.emplace(parts->points, square);
  // The GICP paper uses the 20 nearest points. 10 of every second point cover the same area in half
  // the time; small scans need all points.
  const bool many = parts->points.size() >= 8000;
  std::vector<Eigen::Vector3f> half;
  for (size_t i = 0; many && i < parts->points.size(); i += 2) half.push_back(parts->points[i]);
  std::optional<NearestNeighbors> tree_of_half;
  if (many) tree_of_half.emplace(half, square);
  const std::vector<Eigen::Vector3f>& others = many ? half : parts->points;
  const NearestNeighbors& tree = many ? *tree_of_half : *parts->tree;
  std::vector<Neighbor> neighbors(many ? 10 : 20);
  float radius = square;
  for (const Eigen::Vector3f& point : parts->points) {
    while (tree.nearest(point, radius * radius, neighbors) < neighbors.size()) radius *= 2;
    radius = 1.25F * std::sqrt(neighbors.back().squared) + 0.01F;  // for the next point
    parts->normals.push_back(normal_of(others, neighbors));
    if (is_non_ground(parts->normals.back())) parts->upright.push_back(point);
  }
}

const std::vector<Eigen::Vector3f>& PreparedScan::points() const {
  return parts_->points;
}

const std::vector<Eigen::Vector3f>& PreparedScan::normals() const {
  return parts_->normals;
}

}  // namespace revisit
