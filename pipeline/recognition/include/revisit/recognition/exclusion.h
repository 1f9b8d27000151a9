#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>

namespace revisit::pipeline {

/// Scans too close in time to be a revisit: a candidate must be MORE than `amount` away.
struct Exclusion {
  enum class Kind {
    kNone,     // every other scan may match
    kFrames,   // difference of frame numbers
    kSeconds,  // difference of time stamps [s]
    kMetres,   // length of the path driven between the two [m]
  };
  Kind kind = Kind::kFrames;
  double amount = 50;
  bool operator==(const Exclusion&) const = default;
};
/// "frames=50", "seconds=30", "metres=50" or "none"; throws UsageError for anything else, which
/// `what` begins.
Exclusion parse_exclusion(const std::string& text, const char* what = "exclusion");
std::string to_string(const Exclusion& exclusion);

/// What an exclusion counts in, scan after scan of a drive: frames, seconds or metres driven.
class WayDriven {
 public:
  explicit WayDriven(Exclusion::Kind kind) : kind_(kind) {}
  /// At the next scan. Throws UsageError when the time or the position is needed and not there.
  double at(int64_t frame, const std::optional<double>& time,
            const std::optional<Eigen::Vector3d>& position);

 private:
  Exclusion::Kind kind_;
  double metres_ = 0;
  std::optional<Eigen::Vector3d> last_;
};

}  // namespace revisit::pipeline
