#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "texture.h"

namespace revisit::simulation {

/// Unit of irradiance: direct sunlight through clear air.
struct Light {
  Eigen::Vector3f to_sun;                          // unit
  float sun = 1;                                   // irradiance, perpendicular to the sun
  float sky = 0.3f;                                // irradiance of the whole sky on level ground
  float exposure_error = 0;                        // auto exposure [stops]
  Eigen::Vector2f wind = Eigen::Vector2f::Zero();  // displacement of the clouds, in sky widths
};

/// `time` [s]. If `changing`, the sun moves an hour per minute, clouds pass, exposure has errors.
Light light_at(uint64_t seed, double time, bool changing);

/// Returns the radiance of air between the camera and distant objects, and of hills at the horizon.
float haze_radiance(const Light& light);
/// Returns the radiance of the sky towards the unit `direction`; hazy hills below the horizon.
float sky_radiance(const Light& light, const Eigen::Vector3f& direction, const Textures& textures);

}  // namespace revisit::simulation
