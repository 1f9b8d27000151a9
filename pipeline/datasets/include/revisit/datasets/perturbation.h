#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// One change of a scan.
struct PerturbationStep {
  /// What changes, and the unit of the amount.
  enum class Kind {
    kTurn,    ///< yaw [deg], left positive; absent: random
    kRoll,    ///< [deg], about x
    kPitch,   ///< [deg], about y
    kHeight,  ///< [m], lowers the sensor; negative: raises it
    kKeep,    ///< fraction of the points that are kept
    kSector,  ///< [deg], width of an occluded sector at a random azimuth
    kBeams,   ///< every n-th beam is kept
    kNoise,   ///< [m], standard deviation of each of x, y, z
    kRange,   ///< [m], maximum range in the ground plane
    kRain,    ///< fraction of the returns that come from 0.5 to 10 m instead
    kTruck,   ///< has no amount
  };
  Kind kind = Kind::kTurn;       ///< what changes
  std::optional<double> amount;  ///< in the unit of the kind
};

/// Steps are applied in order. No steps: unchanged.
using Perturbation = std::vector<PerturbationStep>;

/// Parses steps joined by '+', each `kind=amount`, e.g. `pitch=5+range=30`, `sector=60+sector=60`,
/// `turn`, `truck`, or `none`. Throws UsageError with the text, the step and what was expected.
Perturbation parse_perturbation(std::string_view text);

/// Inverse of parse_perturbation(); also the name in tables.
std::string text_of(const Perturbation& perturbation);

/// Perturbations of the robustness table.
std::vector<Perturbation> standard_perturbations();

/// Draws an augmentation for training and calibration; about a quarter change nothing. Without yaw,
/// so that ground-truth headings stay valid. perturb() may be called with the same seed.
Perturbation random_augmentation(uint64_t seed);

/// Must be incremented if a seed perturbs any scan differently, because features of perturbed scans
/// are cached.
constexpr int kPerturbationVersion = 2;

/// Perturbs a scan. Points without a return are removed, unless the scan is unchanged. The result
/// for a seed is the same in every process, and on every machine with equal sine functions.
///
/// - Beams are found by find_beams() and counted from the lowest. They are dropped before all other
///   steps. If beams cannot be separated, a beam is 1/64 of the elevations of 99 % of the points.
/// - The truck is a box 2.5 m wide, 8 m long and 3.5 m high on the ground, parallel to the sensor's
///   x axis, 2 to 4 m to its left or right. It does not reflect rays without a return.
void perturb(PointCloud& cloud, const Perturbation& perturbation, uint64_t seed);

}  // namespace revisit
