#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

namespace revisit::pipeline {

/// The points nearest to a place. May be asked by several threads at once.
class Neighbours {
 public:
  /// `points` are not copied: they must stay as and where they are.
  explicit Neighbours(const std::vector<Eigen::Vector3f>& points);
  ~Neighbours();

  /// At most `count` points, nearest first: their indices and squared distances [m^2].
  void nearest(const Eigen::Vector3f& place, size_t count, std::vector<uint32_t>* indices,
               std::vector<float>* squares) const;

 private:
  struct Tree;
  std::unique_ptr<const Tree> tree_;
};

}  // namespace revisit::pipeline
