#include "labeled_matches.h"

#include <algorithm>
#include <array>

#include "cli/terminal.h"
#include "loops/recognize.h"
#include "revisit/base/error.h"
#include "revisit/datasets/perturbation.h"
#include "revisit/loops/loop_detector.h"

namespace revisit::cli {
namespace {

/// Absent for a distance that is neither true nor false.
std::optional<bool> is_correct(const Pose& here, const Pose& there, const MatchRule& rule) {
  const double meters = distance_between(here.translation(), there.translation(), rule.distance);
  if (rule.is_correct(meters)) return true;
  if (rule.is_incorrect(meters)) return false;
  return std::nullopt;
}

}  // namespace

std::vector<LabeledMatch> labeled_matches(const Dataset& drive, Map& map,
                                          const LabelingOptions& options) {
  RecentEntries recent(options.exclusion);
  std::vector<Pose> poses;  // of the map entries
  std::vector<LabeledMatch> matches;
  PointCloud cloud, perturbed;
  int64_t done = 0;
  uint64_t seed = options.seed;
  for (const ScanRef& scan : drive.scans) {
    if (interrupted()) throw Interrupted("interrupted during the evaluation of matches");
    options.done(++done, std::ssize(drive.scans));
    const auto neighbors = recent.at({scan.frame, scan.time, scan.pose});
    DescribedScan described = describe_scan(scan, drive.sequence, map, cloud);
    if (!described.description.described()) {
      ++*options.skipped;
      warn_skipped(described.description.error);
      continue;
    }
    const auto query = [&](const Description& description, bool is_perturbed) {
      const auto loop = map.query(description, neighbors);
      if (!loop) return;
      const auto correct =
          is_correct(*scan.pose, poses[static_cast<size_t>(loop->index)], options.rule);
      if (correct) matches.push_back({{loop->score, *correct}, is_perturbed, *scan.pose});
    };
    query(described.description, false);
    for (int copy = 0; copy < options.augmentations && !poses.empty(); ++copy, ++seed) {
      const Perturbation perturbation = random_augmentation(seed);
      if (perturbation.empty()) continue;  // a copy of the scan
      perturbed = cloud;
      perturb(perturbed, perturbation, seed);
      query(map.describe(view_of(perturbed)), true);
    }
    described.entry.feature = described.description.feature;
    recent.add(map.add({described.entry}).front());
    poses.push_back(*scan.pose);
  }
  return matches;
}

std::vector<LabeledMatch> labeled_loops(const Dataset& drive, LoopDetector& detector,
                                        const MatchRule& rule, bool deskew,
                                        const std::function<void(int64_t, int64_t)>& done) {
  std::vector<LabeledMatch> matches;
  const auto scans = static_cast<int64_t>(drive.scans.size());
  recognize(stream_of(with_sensor_poses(drive)), detector, deskew,
            [&, n = int64_t{0}](const Visit& visit) mutable {
              done(++n, scans);
              if (!visit.found.error.empty()) warn_skipped(visit.found.error);
              if (!visit.found.loop) return;
              const Loop& loop = *visit.found.loop;
              const auto correct = is_correct(*visit.scan.pose, *loop.pose, rule);
              if (correct) matches.push_back({{loop.score, *correct}, false, *visit.scan.pose});
            });
  return matches;
}

std::vector<LabeledScore> scores_by_place(std::span<const LabeledMatch> matches,
                                          const MatchRule& rule) {
  std::array<std::vector<Eigen::Vector3d>, 2> places;  // of incorrect matches, of correct matches
  std::array<std::vector<double>, 2> counts;
  std::vector<size_t> place_of;
  for (const LabeledMatch& match : matches) {
    const size_t correct = match.score.correct ? 1 : 0;
    const Eigen::Vector3d here = match.pose.translation();
    const auto place = std::ranges::find_if(places[correct], [&](const Eigen::Vector3d& p) {
      return rule.is_correct(distance_between(p, here, rule.distance));
    });
    place_of.push_back(static_cast<size_t>(place - places[correct].begin()));
    if (place == places[correct].end()) {
      places[correct].push_back(here);
      counts[correct].push_back(0);
    }
    ++counts[correct][place_of.back()];
  }
  std::vector<LabeledScore> scores;
  for (size_t i = 0; i < matches.size(); ++i) {
    scores.push_back(matches[i].score);
    scores.back().weight = 1 / counts[matches[i].score.correct ? 1 : 0][place_of[i]];
  }
  return scores;
}

MatchRule rule_of(double radius, const Dataset& drive) {
  if (!(radius > 0)) throw UsageError("--radius: expected a positive number, found ", radius);
  return {horizontal_distance(drive), radius, 2 * radius};
}

}  // namespace revisit::cli
