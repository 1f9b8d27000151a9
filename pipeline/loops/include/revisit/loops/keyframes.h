#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "revisit/maps/place_recognizer.h"

namespace revisit::pipeline {

/// Which scans of a drive become places. All are compared.
struct KeyframeRule {
  enum class Kind {
    kAll,
    kMetres,      // at least so far from the last keyframe, by the poses [m]
    kSimilarity,  // less similar than this to the last keyframe, -1 to 1
  };
  Kind kind = Kind::kAll;
  double amount = 0;
};
/// "all", "metres=1" or "similarity=0.9"; throws UsageError for anything else.
KeyframeRule parse_keyframes(const std::string& text);

/// Follows a drive and tells its keyframes.
class Keyframes {
 public:
  explicit Keyframes(const KeyframeRule& rule) : rule_(rule) {}
  /// Whether the scan is a keyframe. Throws UsageError when the rule needs a pose and there is
  /// none.
  bool is_one(const PlaceRecognizer& recognizer, const Description& scan,
              const std::optional<Eigen::Isometry3d>& pose) const;
  /// The scan is the place at `position` now.
  void add(int64_t position, const std::optional<Eigen::Isometry3d>& pose);

 private:
  KeyframeRule rule_;
  std::optional<int64_t> last_;
  std::optional<Eigen::Isometry3d> pose_;  // of the last
};

}  // namespace revisit::pipeline
