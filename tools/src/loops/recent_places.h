#pragma once

#include <cstdint>
#include <deque>
#include <span>
#include <vector>

#include "revisit/datasets/dataset.h"
#include "revisit/evaluation/ground_truth.h"

namespace revisit::cli {

/// The places of a drive that are of the same moment as its next scan, and no loops.
class RecentPlaces {
 public:
  explicit RecentPlaces(const pipeline::Exclusion& exclusion)
      : exclusion_(exclusion), driven_(exclusion.kind) {}
  /// Their positions in the recogniser, at the next scan. Throws UsageError for an exclusion that
  /// the scan knows nothing of.
  std::span<const int64_t> at(const pipeline::ScanRef& scan);
  /// The scan that at() was called with is a place now.
  void add(int64_t position);

 private:
  struct Place {
    int64_t position = 0;
    double along = 0;  // the drive, in frames, seconds or metres
  };
  pipeline::Exclusion exclusion_;
  pipeline::WayDriven driven_;
  double along_ = 0;
  std::deque<Place> places_;
  std::vector<int64_t> positions_;
};

}  // namespace revisit::cli
