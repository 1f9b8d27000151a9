#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>

#include "mesh.h"

namespace revisit::pipeline::simulation {

/// What a ray met first.
struct Hit {
  float range = -1;         // [m], negative: nothing
  float cos_incidence = 0;  // of the angle between ray and surface normal, >= 0
  Surface surface;
  const Mesh* mesh = nullptr;  // of the town or of what moves
  uint32_t triangle = 0;       // of the mesh
  float u = 0, v = 0;          // barycentric coordinates: corner 0 + u (1 - 0) + v (2 - 0)
};

/// A scene of triangles. Embree builds its tree in one thread: its shape, and so which of two
/// touching triangles is hit, never depends on timing.
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

/// Casts rays into a static scene and a few moving objects. One per thread.
class RayCaster {
 public:
  explicit RayCaster(const Scene& scene);
  ~RayCaster();

  /// Sets what moves, where it is now. Hits of earlier casts must not be used any more.
  void place(Mesh moving);
  /// From `origins`, one for all or one for each, along unit `directions` up to `max_range`:
  /// hits[i] belongs to directions[i]. Neighbouring rays should be nearly parallel: they share the
  /// work.
  void cast(std::span<const Eigen::Vector3f> origins, std::span<const Eigen::Vector3f> directions,
            float max_range, std::span<Hit> hits);
  void cast(const Eigen::Vector3f& origin, std::span<const Eigen::Vector3f> directions,
            float max_range, std::span<Hit> hits) {
    cast(std::span(&origin, 1), directions, max_range, hits);
  }
  /// Whether anything is within `max_range` of origins[i] along the unit `direction`.
  void obstructed(std::span<const Eigen::Vector3f> origins, const Eigen::Vector3f& direction,
                  float max_range, std::span<uint8_t> result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace revisit::pipeline::simulation
