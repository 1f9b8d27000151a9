#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>

namespace revisit::pipeline {

/// Excludes temporal neighbors: a candidate must be MORE than `amount` away to be a revisit.
struct Exclusion {
  enum class Kind {
    kNone,     // all other scans are candidates
    kFrames,   // difference of frame indices
    kSeconds,  // difference of time stamps [s]
    kMeters,   // path length between the two [m]
  };
  Kind kind = Kind::kFrames;
  double amount = 50;
  bool operator==(const Exclusion&) const = default;
};
/// Parses "frames=50", "seconds=30", "meters=50" or "none"; throws UsageError for anything else,
/// with a message that begins with `what`.
Exclusion parse_exclusion(const std::string& text, const char* what = "exclusion");
std::string to_string(const Exclusion& exclusion);

/// Position of each scan along the drive in the unit of an exclusion: frames, seconds or meters.
class ExclusionCounter {
 public:
  explicit ExclusionCounter(Exclusion::Kind kind) : kind_(kind) {}
  /// Returns the position of the next scan. Throws UsageError if a required time or pose is
  /// missing.
  double at(int64_t frame, const std::optional<double>& time,
            const std::optional<Eigen::Vector3d>& position);

 private:
  Exclusion::Kind kind_;
  double meters_ = 0;
  std::optional<Eigen::Vector3d> last_;
};

}  // namespace revisit::pipeline
