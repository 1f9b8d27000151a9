#pragma once

#include <Eigen/Core>

#include "ray_caster.h"
#include "texture.h"

namespace revisit::pipeline::simulation {

struct Paint {
  float albedo = 0.5f;  // share of light given back in all directions
  float gloss = 0;      // share of the mirror image of the sky, at normal incidence
};

/// Where a ray met a surface.
struct SurfacePoint {
  const Hit* hit;
  Eigen::Vector3f position;  // in the town [m]
  Eigen::Vector3f normal;    // unit, towards the viewer
  float footprint;           // side of the square that a pixel covers there [m]
};

/// No detail of the paint is finer than the footprint, and every visit sees the same.
Paint paint_at(const SurfacePoint& point, const Textures& textures);

}  // namespace revisit::pipeline::simulation
