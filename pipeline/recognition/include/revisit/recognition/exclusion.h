#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>

namespace revisit {

/// Excludes temporal neighbors: a candidate must be MORE than `amount` away to be a revisit.
struct Exclusion {
  enum class Kind {
    kNone,
    kFrames,   // difference of frame indices
    kSeconds,  // difference of time stamps [s]
    kMeters,   // path length between the two [m]
  };
  Kind kind = Kind::kFrames;
  double amount = 50;
  bool operator==(const Exclusion&) const = default;
};
/// Parses "frames=50", "seconds=30", "metres=50" ("meters=50") or "none". Throws UsageError,
/// prefixed by `what`.
Exclusion parse_exclusion(const std::string& text, const char* what = "exclusion");
std::string to_string(const Exclusion& exclusion);

class ExclusionCounter {
 public:
  explicit ExclusionCounter(Exclusion::Kind kind) : kind_(kind) {}
  /// Position of the next scan in frames, seconds or meters. Throws UsageError without time or
  /// pose.
  double at(int64_t frame, const std::optional<double>& time,
            const std::optional<Eigen::Vector3d>& position);

 private:
  Exclusion::Kind kind_;
  double meters_ = 0;
  std::optional<Eigen::Vector3d> last_;
};

}  // namespace revisit
