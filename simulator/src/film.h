#pragma once

#include <cstdint>
#include <span>

#include "random.h"
#include "revisit/datasets/scan_file.h"

namespace revisit::simulation {

/// `radiance` is [height][width]. Auto exposure uses the lower two thirds of the image (without the
/// sky) and has an error of `stops`. Photon and read noise, saturation and gamma follow.
GrayImage develop(std::span<const float> radiance, int width, int height, float stops,
                  uint64_t noise_seed);

}  // namespace revisit::simulation
