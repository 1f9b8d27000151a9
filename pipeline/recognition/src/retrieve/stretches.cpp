#include "revisit/recognition/stretches.h"

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

void Stretches::add(std::span<const DriveScan> scans, const PlaceIndex& index) {
  const int64_t first = size();
  std::vector<int64_t> added(scans.size());
  std::iota(added.begin(), added.end(), 0);
  of_entry_.resize(of_entry_.size() + scans.size());
  std::ranges::stable_sort(added, {}, [&](int64_t i) {
    const DriveScan& scan = scans[static_cast<size_t>(i)];
    return std::tie(scan.drive, scan.frame);
  });
  for (const int64_t i : added) add(first + i, scans[static_cast<size_t>(i)], index);
}

void Stretches::add(int64_t entry, const DriveScan& scan, const PlaceIndex& index) {
  const auto [current, is_first] = current_.try_emplace(scan.drive, std::ssize(stretches_));
  bool goes_on = false;
  if (!is_first) {
    Stretch& stretch = stretches_[static_cast<size_t>(current->second)];
    if (!scan.pose) stretch.pose.reset();
    if (stretch.pose)
      stretch.meters =
          std::max(stretch.meters, (scan.pose->translation() - stretch.pose->translation()).norm());
    const std::vector<float> descriptor = index.descriptor(entry);
    if (index.similarity(descriptor, stretch.view) < kSameView) {
      stretch.view = entry;
      ++stretch.views;
    }
    goes_on = index.similarity(descriptor, stretch.first) >= same_place_;
    if (!goes_on) {
      views_.add(stretch.views);
      if (stretch.pose) meters_.add(stretch.meters);
      stretch.behind = std::ssize(stretches_);
    }
  }
  if (!goes_on) {
    const std::optional<int64_t> before = is_first ? std::nullopt : std::optional(current->second);
    current->second = std::ssize(stretches_);
    stretches_.push_back({.first = entry, .view = entry, .pose = scan.pose, .before = before});
  }
  of_entry_[static_cast<size_t>(entry)] = current->second;
  stretches_[static_cast<size_t>(current->second)].entries.push_back(entry);
}

std::span<const int64_t> Stretches::around(int64_t entry) const {
  if (entry >= std::ssize(of_entry_)) return {};
  return stretch_of(entry).entries;
}

std::vector<int64_t> Stretches::near(int64_t entry) const {
  std::vector<int64_t> entries;
  if (entry >= std::ssize(of_entry_)) return entries;
  const Stretch& stretch = stretch_of(entry);
  for (const auto& at :
       {stretch.before, std::optional(of_entry_[static_cast<size_t>(entry)]), stretch.behind})
    if (at) {
      const std::vector<int64_t>& some = stretches_[static_cast<size_t>(*at)].entries;
      entries.insert(entries.end(), some.begin(), some.end());
    }
  return entries;
}

bool Stretches::is_long(int64_t entry) const {
  if (entry >= std::ssize(of_entry_)) return false;
  const Stretch& stretch = stretch_of(entry);
  return stretch.views > kLong * views_.value() &&
         (!stretch.pose || stretch.meters > kLong * meters_.value());
}

}  // namespace revisit
