#pragma once

#include <Eigen/Core>

#include "ray_caster.h"
#include "texture.h"

namespace revisit::pipeline::simulation {

/// What the camera needs to know of a surface at a point.
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

/// The paint at a point: bricks, slabs, leaves, posters... None of its details is finer than the
/// footprint. It belongs to the place and the object, so every visit sees the same.
Paint paint_at(const SurfacePoint& point, const Textures& textures);

}  // namespace revisit::pipeline::simulation
