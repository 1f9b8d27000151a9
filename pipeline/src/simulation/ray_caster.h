#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

#include "mesh.h"

namespace revisit::pipeline::simulation {

/// What a ray met first.
struct Hit {
  float range = -1;         // [m], negative: nothing
  float cos_incidence = 0;  // of the angle between ray and surface normal, >= 0
  Surface surface;
};

/// A scene of triangles that rays can be cast into; Embree builds the tree. The tree is built by
/// one thread: its shape, and so which of two touching triangles is hit, never depends on timing.
class Scene {
 public:
  /// Throws Error when memory does not suffice.
  explicit Scene(Mesh mesh);
  ~Scene();
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;
  const Mesh& mesh() const;

 private:
  friend class RayCaster;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Casts the rays of one scan into a static scene and a few moving objects. One per thread.
class RayCaster {
 public:
  explicit RayCaster(const Scene& scene);
  ~RayCaster();

  /// From `origin` along unit `directions` up to `max_range`: hits[i] belongs to directions[i].
  /// Neighbouring directions should be nearly parallel: they share the work.
  void cast(const Mesh& moving, const Eigen::Vector3f& origin,
            std::span<const Eigen::Vector3f> directions, float max_range, std::span<Hit> hits);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace revisit::pipeline::simulation
