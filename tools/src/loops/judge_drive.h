#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "revisit/datasets/dataset.h"
#include "revisit/evaluation/ground_truth.h"
#include "revisit/loops/loop_detector.h"
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
  pipeline::Pose pose;   // of the scan
};

/// A recogniser without places, which gets the frames whose numbers are multiples of `every`.
struct SpacedRecognizer {
  pipeline::PlaceRecognizer* recognizer;
  int every = 1;
};

/// The best matches of a drive's scans, each asked among those before it as
/// recognise() does it, and whether the matches are right by the poses. The places are the scans as
/// they are. Matches that are neither right nor wrong are left out, as are scans that cannot be
/// described and copies that their alteration leaves as they are. All recognisers are of one
/// feature: a scan is described once.
/// Throws what recognise() does, UsageError for a drive without poses.
std::vector<JudgedMatch> judge_drive(const pipeline::Dataset& drive,
                                     std::span<const SpacedRecognizer> recognizers,
                                     const JudgeDrive& options);

/// Matches of a detector on a drive with poses (recognise(), with `deskew`), judged by the poses.
/// Matches that are neither right nor wrong are left out. Throws as judge_drive().
std::vector<JudgedMatch> judge_loops(const pipeline::Dataset& drive,
                                     pipeline::LoopDetector& detector,
                                     const pipeline::TrueMatchRule& rule, bool deskew,
                                     const std::function<bool()>& stop,
                                     const std::function<void(int64_t, int64_t)>& done);

/// The scores of a drive's matches. All right ones of a place have the weight of one together, as
/// have all wrong ones: scans of a place, and altered copies of one, tell the same. A place begins
/// `radius` [m] from all before it.
std::vector<pipeline::JudgedScore> scores_by_place(std::span<const JudgedMatch> matches,
                                                   const pipeline::TrueMatchRule& rule);

/// Nearer than `radius` [m] is right, twice as far is wrong: between the two a vehicle is as good
/// as back, but not where the match says.
pipeline::TrueMatchRule rule_of(double radius);

}  // namespace revisit::cli
