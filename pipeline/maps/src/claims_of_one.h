#pragma once

#include <atomic>
#include <iterator>
#include <set>

#include "revisit/maps/map_store.h"

namespace revisit::pipeline {

/// What a map expects that only one process writes: kept in its memory.
class ClaimsOfOne {
 public:
  /// `there`: frames that have a place.
  void expect(const std::string& drive, std::span<const int64_t> frames,
              const std::set<int64_t>& there) {
    for (const int64_t frame : frames)
      if (!there.contains(frame) && !left_out_[drive].contains(frame))
        expected_[drive].insert(frame);
  }

  std::unique_ptr<Claim> claim(const std::string& drive, int64_t most) {
    if (most < 1) throw UsageError(str("a claim of ", most, " scans: expected at least 1"));
    if (*claimed_) throw UsageError("the previous claim has not ended");
    const std::set<int64_t>& frames = expected_[drive];
    if (frames.empty()) return nullptr;
    auto claim = std::make_unique<OwnClaim>(claimed_);
    claim->drive = drive;
    const auto n = std::min(most, static_cast<int64_t>(frames.size()));
    std::copy_n(frames.begin(), n, std::back_inserter(claim->frames));
    return claim;
  }

  void end(const Claim& claim, std::span<const StoredPlace> added) {
    for (const StoredPlace& place : added) expected_[claim.drive].erase(place.frame);
    for (const auto& [frame, why] : claim.left_out) {
      expected_[claim.drive].erase(frame);
      left_out_[claim.drive].insert(frame);
    }
  }

  int64_t expected(const std::string& drive) const {
    const auto found = expected_.find(drive);
    return found == expected_.end() ? 0 : static_cast<int64_t>(found->second.size());
  }

 private:
  struct OwnClaim : Claim {
    explicit OwnClaim(std::shared_ptr<std::atomic<bool>> is_claimed)
        : claimed(std::move(is_claimed)) {
      *claimed = true;
    }
    ~OwnClaim() override { *claimed = false; }
    OwnClaim(const OwnClaim&) = delete;
    OwnClaim& operator=(const OwnClaim&) = delete;
    std::shared_ptr<std::atomic<bool>> claimed;
  };
  std::map<std::string, std::set<int64_t>> expected_, left_out_;
  // Any thread may end a claim.
  std::shared_ptr<std::atomic<bool>> claimed_ = std::make_shared<std::atomic<bool>>(false);
};

}  // namespace revisit::pipeline
