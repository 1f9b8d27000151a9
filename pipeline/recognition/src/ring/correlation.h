#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>

#include "revisit/recognition/ring/descriptor.h"
#include "ring/spectrum.h"

namespace revisit {

inline constexpr int kRingYaws = 360;

/// Cosines and sines of all frequencies at the first `kTurns` of `kYaws` angles of a revolution,
/// padded with the last one. Symmetry gives the other angles.
template <int kYaws, size_t kTurns, size_t kPadded = kTurns>
struct RingWaves {
  static constexpr size_t kSize = kPadded;
  alignas(64) std::array<std::array<float, kPadded>, kRingFrequencies> cosines, sines;

  RingWaves() {
    for (size_t f = 0; f < kRingFrequencies; ++f)
      for (size_t t = 0; t < kPadded; ++t) {
        const double angle =
            2 * std::numbers::pi * static_cast<double>(f * std::min(t, kTurns - 1)) / kYaws;
        cosines[f][t] = static_cast<float>(std::cos(angle));
        sines[f][t] = static_cast<float>(std::sin(angle));
      }
  }
};
/// Half a revolution. A correlation is sum(real cos) - sum(imaginary sin); at the opposite angle
/// the sines change sign.
using HalfTurn = RingWaves<kRingYaws, kRingYaws / 2 + 1, (kRingYaws / 2 + 16) / 16 * 16>;

/// Largest correlation (METHODS, eq. 6) of `a` with each of `rows[i]` over kRingYaws yaw angles.
void max_correlations(const float* a, std::span<const float* const> rows, const RingLayout& layout,
                      std::span<double> largest);

struct RingMatch {
  double similarity = 0;    // -1 .. 1
  double relative_yaw = 0;  // yaw(b) - yaw(a), counter-clockwise [rad], (-pi, pi]
};
/// Finds the maximum of the circular correlation over 360 yaw angles, then refines the yaw.
RingMatch match_rings(std::span<const float> a, std::span<const float> b, const RingLayout& layout);

}  // namespace revisit
