#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "revisit/recognition/match.h"

namespace revisit {

struct ScanStamp {
  int64_t frame = 0;
  std::optional<double> time;             // [s]
  std::optional<Eigen::Isometry3d> pose;  // T_world_sensor
};

/// Entries of a drive that are temporal neighbors of its next scan and excluded from matching.
class RecentPlaces {
 public:
  explicit RecentPlaces(const Exclusion& exclusion)
      : exclusion_(exclusion), driven_(exclusion.kind) {}
  /// Indices of the entries excluded for this scan. Throws UsageError if the exclusion needs a time
  /// or a pose that the scan lacks.
  std::span<const int64_t> at(const ScanStamp& scan);
  /// Adds the scan of the last at() as the entry at the index `position`.
  void add(int64_t position);

 private:
  struct Place {
    int64_t index = 0;
    double along = 0;  // distance along the drive, in frames, seconds or meters
  };
  Exclusion exclusion_;
  ExclusionCounter driven_;
  double along_ = 0;
  std::deque<Place> places_;
  std::vector<int64_t> positions_;
};

}  // namespace revisit
