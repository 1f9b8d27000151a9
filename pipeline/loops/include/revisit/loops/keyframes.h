#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "revisit/maps/place_recognizer.h"

namespace revisit {

/// Selects the scans that become map entries. All scans are queries.
struct KeyframeRule {
  enum class Kind {
    kAll,
    kMeters,      // distance from the last keyframe, by the poses, is at least `amount` [m]
    kSimilarity,  // similarity to the last keyframe is below `amount`, -1 to 1
  };
  Kind kind = Kind::kAll;
  double amount = 0;
};
/// "all", "meters=1" or "similarity=0.9"; throws UsageError for anything else.
KeyframeRule parse_keyframes(const std::string& text);

class Keyframes {
 public:
  explicit Keyframes(const KeyframeRule& rule) : rule_(rule) {}
  /// Throws UsageError if the rule needs a pose and there is none.
  bool is_one(const PlaceRecognizer& recognizer, const Description& scan,
              const std::optional<Eigen::Isometry3d>& pose) const;
  /// `position`: index of the entry.
  void add(int64_t position, const std::optional<Eigen::Isometry3d>& pose);

 private:
  KeyframeRule rule_;
  std::optional<int64_t> last_;
  std::optional<Eigen::Isometry3d> pose_;
};

}  // namespace revisit
