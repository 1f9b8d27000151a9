#include "judge_drive.h"

#include "loops/describe_scan.h"
#include "revisit/base/error.h"
#include "revisit/datasets/alteration.h"
#include "revisit/loops/recent_places.h"

namespace revisit::cli {

std::vector<JudgedMatch> judge_drive(const pipeline::Dataset& drive,
                                     pipeline::PlaceRecognizer& recognizer,
                                     const JudgeDrive& options) {
  if (!drive.has_poses()) throw UsageError(drive.name, ": judging matches needs poses");
  pipeline::RecentPlaces recent(options.exclusion);
  std::vector<JudgedMatch> matches;
  pipeline::PointCloud cloud, altered;
  int64_t done = 0;
  uint64_t asked = 0;  // altered copies
  for (const pipeline::ScanRef& scan : drive.scans) {
    if (options.stop()) throw Interrupted("stopped while matches were judged");
    options.done(++done, static_cast<int64_t>(drive.scans.size()));
    const std::span<const int64_t> without = recent.at({scan.frame, scan.time, scan.pose});
    DescribedScan described = describe_scan(scan, drive.sequence, recognizer, cloud);
    if (!described.description.described()) {
      options.left_out(described.description.why_not);
      continue;
    }
    const auto ask = [&](const pipeline::Description& description, bool is_altered) {
      const auto loop = recognizer.query(description, without);
      if (!loop) return;
      const double metres = distance_between(scan.pose->translation(), loop->pose->translation(),
                                             options.rule.distance);
      if (options.rule.is_true(metres) || options.rule.is_false(metres))
        matches.push_back({{loop->score, options.rule.is_true(metres)}, is_altered});
    };
    ask(described.description, false);
    for (int copy = 0; copy < options.altered && recognizer.size() > 0; ++copy) {
      const uint64_t seed = options.seed + asked++;
      const pipeline::Alteration alteration = pipeline::random_alteration(seed);
      if (alteration.steps.empty()) continue;  // asked already
      altered = cloud;
      alter(altered, alteration, seed);
      ask(recognizer.describe(view_of(altered)), true);
    }
    recent.add(recognizer.add(described.description, std::move(described.place)));
  }
  return matches;
}

pipeline::TrueMatchRule rule_of(double radius) {
  if (!(radius > 0)) throw UsageError("--radius: expected a positive number, found ", radius);
  return {.radius = radius, .false_beyond = 2 * radius};
}

}  // namespace revisit::cli
