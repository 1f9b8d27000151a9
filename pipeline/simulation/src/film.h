#pragma once

#include <cstdint>
#include <span>

#include "random.h"
#include "revisit/datasets/gray_png.h"

namespace revisit::pipeline::simulation {

/// Simulates the exposure of radiances [height][width]. Auto exposure uses the lower two thirds of
/// the image (without the sky) and has an error of `stops`. Then follow photon and read noise,
/// saturation, and the gamma curve.
GrayImage develop(std::span<const float> radiance, int width, int height, float stops,
                  uint64_t noise_seed);

}  // namespace revisit::pipeline::simulation
