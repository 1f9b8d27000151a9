#pragma once

#include <Eigen/Core>

#include "ray_caster.h"
#include "texture.h"

namespace revisit::simulation {

struct Paint {
  float albedo = 0.5f;  // fraction of diffusely reflected light
  float gloss = 0;      // fraction of specularly reflected sky, at normal incidence
};

struct SurfacePoint {
  const Hit* hit;
  Eigen::Vector3f position;  // [m], town frame
  Eigen::Vector3f normal;    // unit, towards the viewer
  float footprint;           // [m], side of the square covered by a pixel
};

/// Details are not finer than the footprint, and equal for every visit.
Paint paint_at(const SurfacePoint& point, const Textures& textures);

}  // namespace revisit::simulation
