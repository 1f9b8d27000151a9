#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "revisit/datasets/dataset.h"
#include "revisit/evaluation/ground_truth.h"
#include "revisit/maps/place_recognizer.h"

namespace revisit::cli {

struct JudgeDrive {
  pipeline::Exclusion exclusion;
  pipeline::TrueMatchRule rule;
  int altered = 0;    // copies of every scan, altered at random, that are asked beside it
  uint64_t seed = 0;  // of the alterations
  std::function<void(const std::string& why)> left_out = [](const std::string&) {};
  std::function<bool()> stop = [] { return false; };
  std::function<void(int64_t done, int64_t total)> done = [](int64_t, int64_t) {};
};

struct JudgedMatch {
  pipeline::JudgedScore judged;
  bool altered = false;  // the scan
};

/// The best matches of a drive's scans, each asked among those before it as
/// recognise() does it, and whether the matches are right by the poses. The places are the scans as
/// they are. Matches that are neither right nor wrong are left out, as are scans that cannot be
/// described and copies that their alteration leaves as they are. `recognizer` has no places yet.
/// Throws what recognise() does, UsageError for a drive without poses.
std::vector<JudgedMatch> judge_drive(const pipeline::Dataset& drive,
                                     pipeline::PlaceRecognizer& recognizer,
                                     const JudgeDrive& options);

/// Nearer than `radius` [m] is right, twice as far is wrong: between the two a vehicle is as good
/// as back, but not where the match says.
pipeline::TrueMatchRule rule_of(double radius);

}  // namespace revisit::cli
