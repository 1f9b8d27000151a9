#pragma once

#include <cstdint>
#include <span>

#include "random.h"
#include "revisit/datasets/gray_png.h"

namespace revisit::pipeline::simulation {

/// What a camera makes of radiances [height][width]: its automatic sets the exposure by the lower
/// two thirds of the picture (not by the sky) with an error of `stops`; then come the sensor's
/// noise, of photons and of reading, saturation and the gamma curve.
GrayImage develop(std::span<const float> radiance, int width, int height, float stops,
                  uint64_t noise_seed);

}  // namespace revisit::pipeline::simulation
