#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

struct AlterationStep {
  enum class Kind {
    kTurn,    // yaw [deg], left positive; without amount a random one
    kRoll,    // [deg] about x
    kPitch,   // [deg] about y
    kHeight,  // [m] that the sensor is lower; negative: higher
    kKeep,    // share of the points that stay
    kSector,  // width [deg] of a sector that is hidden, at a random azimuth
    kBeams,   // every n-th beam stays
    kNoise,   // standard deviation [m] of each of x, y, z
    kRange,   // [m] on the ground plane; nothing beyond it is seen
    kRain,    // share of the returns that come from 0.5 to 10 m instead
    kTruck,   // a truck beside the sensor; no amount
  };
  Kind kind = Kind::kTurn;
  std::optional<double> amount;
};

/// Steps, taken one after the other. Without any: the scan as it is.
struct Alteration {
  std::vector<AlterationStep> steps;
};

/// Reads steps joined by '+', each `kind=amount`, e.g. `pitch=5+range=30`, `sector=60+sector=60`,
/// `turn`, `truck`, or `none`. Throws UsageError with the text, the step and what was expected.
Alteration parse_alteration(std::string_view text);

std::string text_of(const Alteration& alteration);

/// For tables: "pitch 5 deg + nearer than 30 m".
std::string name_of(const Alteration& alteration);

/// The rows of the table of robustness.
std::vector<Alteration> standard_alterations();

/// A mixture for learning and calibration; about a quarter are none. Never turned by yaw: the
/// headings of a drive stay true. alter() may be given the same seed.
Alteration random_alteration(uint64_t seed);

/// To be raised when a seed alters some scan otherwise: features of altered scans are kept.
constexpr int kAlterationVersion = 2;

/// Alters a scan; points without a return are left out, unless the scan stays as it is. The result
/// is the same for a seed in every process and on every machine whose sines are the same.
///
/// - Beams, found by find_beams() and counted from the lowest, are dropped first, wherever the step
///   stands. Where there are none, a beam is 1/64 of the elevations that 99 % of the points have.
/// - The truck is a box 2.5 m wide, 8 m long and 3.5 m high on the ground, parallel to the sensor's
///   x axis, 2 to 4 m to its left or right. Rays without a return give none of the truck, either.
void alter(PointCloud& cloud, const Alteration& alteration, uint64_t seed);

}  // namespace revisit::pipeline
