#include "judge_drive.h"

#include "loops/describe_scan.h"
#include "loops/recent_places.h"
#include "revisit/base/error.h"
#include "revisit/datasets/alteration.h"

namespace revisit::cli {
namespace {

/// Of the distance between a scan and its match: nothing when it is neither right nor wrong.
std::optional<bool> is_right(const pipeline::Pose& here, const pipeline::Pose& there,
                             const pipeline::TrueMatchRule& rule) {
  const double metres = distance_between(here.translation(), there.translation(), rule.distance);
  if (rule.is_true(metres)) return true;
  if (rule.is_false(metres)) return false;
  return std::nullopt;
}

}  // namespace

std::vector<JudgedMatch> judge_drive(const pipeline::Dataset& drive,
                                     pipeline::PlaceRecognizer& recognizer,
                                     const JudgeDrive& options) {
  if (!drive.has_poses()) throw UsageError(str(drive.name, ": judging matches needs poses"));
  RecentPlaces recent(options.exclusion);
  std::vector<pipeline::Pose> poses;  // of the places
  std::vector<JudgedMatch> matches;
  pipeline::PointCloud cloud, altered;
  int64_t done = 0;
  uint64_t asked = 0;  // altered copies
  for (const pipeline::ScanRef& scan : drive.scans) {
    if (options.stop()) throw Interrupted("stopped while matches were judged");
    options.done(++done, static_cast<int64_t>(drive.scans.size()));
    const std::span<const int64_t> without = recent.at(scan);
    DescribedScan described = describe_scan(scan, drive.sequence, recognizer, cloud);
    if (!described.description.described()) {
      options.left_out(described.description.why_not);
      continue;
    }
    const auto ask = [&](const pipeline::Description& description, bool is_altered) {
      const auto loop = recognizer.query(description, without);
      if (!loop) return;
      const auto right =
          is_right(*scan.pose, poses[static_cast<size_t>(loop->position)], options.rule);
      if (right) matches.push_back({{loop->score, *right}, is_altered});
    };
    ask(described.description, false);
    for (int copy = 0; copy < options.altered && !poses.empty(); ++copy) {
      const uint64_t seed = options.seed + asked++;
      const pipeline::Alteration alteration = pipeline::random_alteration(seed);
      if (alteration.steps.empty()) continue;  // asked already
      altered = cloud;
      alter(altered, alteration, seed);
      ask(recognizer.describe(view_of(altered)), true);
    }
    recent.add(recognizer.add(described.description, std::move(described.place)));
    poses.push_back(*scan.pose);
  }
  return matches;
}

pipeline::TrueMatchRule rule_of(double radius) {
  if (!(radius > 0)) throw UsageError(str("--radius: expected a positive number, found ", radius));
  return {.radius = radius, .false_beyond = 2 * radius};
}

}  // namespace revisit::cli
