#include "stretches.h"

#include <algorithm>
#include <numeric>
#include <tuple>

namespace revisit {

void RunningMedian::add(double number) {
  lower_.push(number);
  upper_.push(lower_.top());
  lower_.pop();
  if (upper_.size() <= lower_.size()) return;
  lower_.push(upper_.top());
  upper_.pop();
}

void Stretches::add(std::span<const StoredPlace> places, const PlaceIndex& index) {
  std::vector<int64_t> added(places.size() - of_place_.size());
  std::iota(added.begin(), added.end(), std::ssize(of_place_));
  of_place_.resize(places.size());
  std::ranges::stable_sort(added, {}, [&](int64_t i) {
    const StoredPlace& place = places[static_cast<size_t>(i)];
    return std::tie(place.drive, place.frame);
  });
  for (const int64_t place : added) add(place, places, index);
}

void Stretches::add(int64_t place, std::span<const StoredPlace> places, const PlaceIndex& index) {
  const StoredPlace& here = places[static_cast<size_t>(place)];
  const auto [current, is_first] = current_.try_emplace(here.drive, std::ssize(stretches_));
  bool goes_on = false;
  if (!is_first) {
    Stretch& stretch = stretches_[static_cast<size_t>(current->second)];
    const auto& pose_there = places[static_cast<size_t>(stretch.first)].pose;
    stretch.has_poses = stretch.has_poses && here.pose && pose_there;
    if (stretch.has_poses)
      stretch.meters =
          std::max(stretch.meters, (here.pose->translation() - pose_there->translation()).norm());
    const std::vector<float> descriptor = index.descriptor(place);
    if (index.similarity(descriptor, stretch.view) < kSameView) {
      stretch.view = place;
      ++stretch.views;
    }
    goes_on = index.similarity(descriptor, stretch.first) >= same_place_;
    if (!goes_on) {
      views_.add(stretch.views);
      if (stretch.has_poses) meters_.add(stretch.meters);
      stretch.behind = std::ssize(stretches_);
    }
  }
  if (!goes_on) {
    const std::optional<int64_t> before = is_first ? std::nullopt : std::optional(current->second);
    current->second = std::ssize(stretches_);
    stretches_.push_back({.first = place, .view = place, .before = before});
  }
  of_place_[static_cast<size_t>(place)] = current->second;
  stretches_[static_cast<size_t>(current->second)].places.push_back(place);
}

std::span<const int64_t> Stretches::around(int64_t place) const {
  if (place >= std::ssize(of_place_)) return {};
  return stretch_of(place).places;
}

std::vector<int64_t> Stretches::near(int64_t place) const {
  std::vector<int64_t> places;
  if (place >= std::ssize(of_place_)) return places;
  const Stretch& stretch = stretch_of(place);
  for (const auto& at :
       {stretch.before, std::optional(of_place_[static_cast<size_t>(place)]), stretch.behind})
    if (at) {
      const std::vector<int64_t>& some = stretches_[static_cast<size_t>(*at)].places;
      places.insert(places.end(), some.begin(), some.end());
    }
  return places;
}

bool Stretches::is_long(int64_t place) const {
  if (place >= std::ssize(of_place_)) return false;
  const Stretch& stretch = stretch_of(place);
  return stretch.views > kLong * views_.value() &&
         (!stretch.has_poses || stretch.meters > kLong * meters_.value());
}

}  // namespace revisit
