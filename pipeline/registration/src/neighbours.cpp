#include "neighbours.h"

#include <nanoflann.hpp>

namespace revisit::pipeline {
namespace {

/// What nanoflann asks of points.
struct Source {
  const std::vector<Eigen::Vector3f>& points;

  size_t kdtree_get_point_count() const { return points.size(); }
  float kdtree_get_pt(size_t point, size_t axis) const {
    return points[point][static_cast<Eigen::Index>(axis)];
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;  // it shall find out
  }
};

using KdTree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Source>,
                                                   Source, 3, uint32_t>;

}  // namespace

struct Neighbours::Tree {
  explicit Tree(const std::vector<Eigen::Vector3f>& points)
      : source{points}, index(3, source, nanoflann::KDTreeSingleIndexAdaptorParams(10)) {}

  Source source;
  KdTree index;
};

Neighbours::Neighbours(const std::vector<Eigen::Vector3f>& points)
    : tree_(std::make_unique<const Tree>(points)) {}

Neighbours::~Neighbours() = default;

void Neighbours::nearest(const Eigen::Vector3f& place, size_t count, std::vector<uint32_t>* indices,
                         std::vector<float>* squares) const {
  indices->resize(count);
  squares->resize(count);
  const size_t found =
      tree_->index.knnSearch(place.data(), count, indices->data(), squares->data());
  indices->resize(found);
  squares->resize(found);
}

}  // namespace revisit::pipeline
