#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "texture.h"

namespace revisit::pipeline::simulation {

/// Irradiance in units of the sun's through clear air, perpendicular to it.
struct Light {
  Eigen::Vector3f to_sun;                          // unit
  float sun = 1;                                   // irradiance, perpendicular to the sun
  float sky = 0.3f;                                // irradiance of the whole sky on level ground
  float exposure_error = 0;                        // of the camera's automatic, in stops
  Eigen::Vector2f wind = Eigen::Vector2f::Zero();  // how far the clouds have come, in sky widths
};

/// The light at a time of the drive [s], without `changing` at time 0. With it the sun moves an
/// hour a minute, clouds pass and the exposure errs.
Light light_at(uint64_t seed, double time, bool changing);

/// Radiance of the air between the camera and what is far, and of hills at the horizon.
float haze_radiance(const Light& light);
/// Radiance of the sky towards the unit `direction`; hazy hills below the horizon.
float sky_radiance(const Light& light, const Eigen::Vector3f& direction, const Textures& textures);

}  // namespace revisit::pipeline::simulation
