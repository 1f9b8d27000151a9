#include "revisit/loops/recent_places.h"

namespace revisit {

std::span<const int64_t> RecentPlaces::at(const ScanStamp& scan) {
  std::optional<Eigen::Vector3d> position;
  if (scan.pose) position = scan.pose->translation();
  along_ = driven_.at(scan.frame, scan.time, position);
  if (exclusion_.kind == Exclusion::Kind::kNone) places_.clear();
  while (!places_.empty() && along_ - places_.front().along > exclusion_.amount)
    places_.pop_front();
  positions_.clear();
  for (const Place& place : places_) positions_.push_back(place.index);
  return positions_;
}

void RecentPlaces::add(int64_t position) {
  places_.push_back({position, along_});
}

}  // namespace revisit
