#pragma once

#include <map>
#include <optional>
#include <string>

#include "revisit/loops/loop_detector.h"

namespace revisit {

class LoopSummary {
 public:
  /// `threshold`: LoopDetector::threshold().
  LoopSummary(const Exclusion& exclusion, std::optional<double> threshold)
      : exclusion_(exclusion), threshold_(threshold) {}
  void add(const Detection& found);
  int64_t scans() const { return scans_; }
  int64_t skipped() const { return skipped_; }  ///< scans that could not be described
  /// "332 scans, 172 loops accepted, 5 more look alike, but their points do not fit"
  std::string text() const;

 private:
  Exclusion exclusion_;
  std::optional<double> threshold_;
  int64_t scans_ = 0, skipped_ = 0, queried_ = 0, accepted_ = 0, few_places_ = 0;
  std::map<Rejection, int64_t> rejected_;
  double best_ = 0;
};

}  // namespace revisit
