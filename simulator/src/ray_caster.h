#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>

#include "mesh.h"

namespace revisit::simulation {

struct Hit {
  float range = -1;         // [m], negative: no hit
  float cos_incidence = 0;  // angle between ray and surface normal; >= 0
  Surface surface;
  const Mesh* mesh = nullptr;  // town or moving objects
  uint32_t triangle = 0;
  float u = 0, v = 0;  // barycentric coordinates: corner 0 + u (1 - 0) + v (2 - 0)
};

/// Embree builds its tree on one thread, because then the tree, and which of two touching triangles
/// is hit, do not depend on timing.
class Scene {
 public:
  /// Throws Error if memory does not suffice.
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

/// Each thread needs its own.
class RayCaster {
 public:
  explicit RayCaster(const Scene& scene);
  ~RayCaster();

  /// Invalidates hits of earlier casts.
  void place(Mesh moving);
  /// `origins` are one for all, or one per ray; `directions` are unit. hits[i] belongs to
  /// directions[i]. Adjacent rays should be nearly parallel, because they are traced together.
  void cast(std::span<const Eigen::Vector3f> origins, std::span<const Eigen::Vector3f> directions,
            float max_range, std::span<Hit> hits);
  void cast(const Eigen::Vector3f& origin, std::span<const Eigen::Vector3f> directions,
            float max_range, std::span<Hit> hits) {
    cast(std::span(&origin, 1), directions, max_range, hits);
  }
  /// Sets result[i] if anything is within `max_range` of origins[i] along the unit `direction`.
  void obstructed(std::span<const Eigen::Vector3f> origins, const Eigen::Vector3f& direction,
                  float max_range, std::span<uint8_t> result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace revisit::simulation
