#include <nanoflann.hpp>

#include "prepared_scan.h"

namespace revisit {
namespace {

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

using KdTree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Source>,
                                                   Source, 3, uint32_t>;

class Results {
 public:
  using DistanceType = float;

  Results(std::span<Neighbor> found, float limit) : found_(found), worst_(limit) {}

  bool addPoint(float squared, uint32_t point) {
    if (count_ < found_.size()) ++count_;
    size_t at = count_ - 1;
    for (; at > 0 && found_[at - 1].squared > squared; --at) found_[at] = found_[at - 1];
    found_[at] = {squared, point};
    if (full()) worst_ = found_.back().squared;
    return true;
  }
  float worstDist() const { return worst_; }
  bool full() const { return count_ == found_.size(); }
  size_t size() const { return count_; }

 private:
  std::span<Neighbor> found_;
  float worst_;
  size_t count_ = 0;
};

}  // namespace

struct NearestNeighbors::Tree {
  explicit Tree(const std::vector<Eigen::Vector3f>& points)
      : source{points}, index(3, source, nanoflann::KDTreeSingleIndexAdaptorParams(10)) {}

  Source source;
  KdTree index;
};

NearestNeighbors::NearestNeighbors(const std::vector<Eigen::Vector3f>& points)
    : tree_(std::make_unique<const Tree>(points)) {}

NearestNeighbors::~NearestNeighbors() = default;

size_t NearestNeighbors::nearest(const Eigen::Vector3f& place, float limit,
                                 std::span<Neighbor> found) const {
  Results results(found, limit);
  tree_->index.findNeighbors(results, place.data(), {});
  return results.size();
}

}  // namespace revisit
