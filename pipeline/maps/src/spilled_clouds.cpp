#include "spilled_clouds.h"

namespace revisit {

void SpilledClouds::take(std::span<StoredPlace> places) {
  std::string clouds;
  for (const StoredPlace& place : places) clouds += place.cloud;
  if (!clouds.empty()) {
    if (!file_) file_.emplace();
    file_->append(std::as_bytes(std::span(clouds)));
  }
  for (StoredPlace& place : places) {
    ends_.push_back(ends_.back() + std::ssize(place.cloud));
    std::string().swap(place.cloud);
  }
}

std::string SpilledClouds::of(int64_t place) const {
  const auto at = static_cast<size_t>(place);
  std::string cloud(static_cast<size_t>(ends_[at + 1] - ends_[at]), '\0');
  if (!cloud.empty()) file_->read(ends_[at], std::as_writable_bytes(std::span(cloud)));
  return cloud;
}

}  // namespace revisit
