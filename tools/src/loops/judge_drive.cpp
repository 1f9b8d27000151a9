#include "judge_drive.h"

#include <algorithm>
#include <array>

#include "cli/messages.h"
#include "loops/describe_scan.h"
#include "loops/recognize.h"
#include "revisit/base/error.h"
#include "revisit/datasets/perturbation.h"
#include "revisit/loops/recent_places.h"

namespace revisit::cli {
namespace {

/// True or false by the distance between a scan and its match; absent in between.
std::optional<bool> is_right(const pipeline::Pose& here, const pipeline::Pose& there,
                             const pipeline::TrueMatchRule& rule) {
  const double meters = distance_between(here.translation(), there.translation(), rule.distance);
  if (rule.is_true(meters)) return true;
  if (rule.is_false(meters)) return false;
  return std::nullopt;
}

/// A recognizer and its map entries.
struct Judge {
  pipeline::PlaceRecognizer& recognizer;
  int every;
  pipeline::RecentPlaces recent;
  std::vector<pipeline::Pose> poses;  // of the map entries
  std::span<const int64_t> without;   // temporal neighbors of the scan
  bool asked = false;                 // the scan is one of its frames
};

}  // namespace

std::vector<JudgedMatch> judge_drive(const pipeline::Dataset& drive,
                                     std::span<const SpacedRecognizer> recognizers,
                                     const JudgeDrive& options) {
  if (!drive.has_poses())
    throw UsageError(drive.name,
                     ": the scans have no poses, which the evaluation of matches needs");
  std::vector<Judge> judges;
  for (const SpacedRecognizer& one : recognizers)
    judges.push_back(
        {*one.recognizer, one.every, pipeline::RecentPlaces(options.exclusion), {}, {}});
  std::vector<JudgedMatch> matches;
  pipeline::PointCloud cloud, altered;
  int64_t done = 0;
  uint64_t copies = 0;
  for (const pipeline::ScanRef& scan : drive.scans) {
    if (options.stop()) throw Interrupted("interrupted during the evaluation of matches");
    options.done(++done, static_cast<int64_t>(drive.scans.size()));
    bool wanted = false, known = false;
    for (Judge& judge : judges) {
      judge.asked = scan.frame % judge.every == 0;
      if (judge.asked) judge.without = judge.recent.at({scan.frame, scan.time, scan.pose});
      wanted = wanted || judge.asked;
      known = known || (judge.asked && !judge.poses.empty());
    }
    if (!wanted) continue;
    DescribedScan described =
        describe_scan(scan, drive.sequence, *recognizers[0].recognizer, cloud);
    if (!described.description.described()) {
      options.left_out(described.description.error);
      continue;
    }
    const auto ask = [&](const pipeline::Description& description, bool is_altered) {
      for (const Judge& judge : judges) {
        if (!judge.asked) continue;
        const auto loop = judge.recognizer.query(description, judge.without);
        if (!loop) continue;
        const auto right =
            is_right(*scan.pose, judge.poses[static_cast<size_t>(loop->index)], options.rule);
        if (right) matches.push_back({{loop->score, *right}, is_altered, *scan.pose});
      }
    };
    ask(described.description, false);
    for (int copy = 0; copy < options.altered && known; ++copy) {
      const uint64_t seed = options.seed + copies++;
      const pipeline::Perturbation alteration = pipeline::random_augmentation(seed);
      if (alteration.steps.empty()) continue;  // a copy of the scan
      altered = cloud;
      perturb(altered, alteration, seed);
      ask(recognizers[0].recognizer->describe(view_of(altered)), true);
    }
    for (Judge& judge : judges) {
      if (!judge.asked) continue;
      judge.recent.add(judge.recognizer.add(described.description, described.place));
      judge.poses.push_back(*scan.pose);
    }
  }
  return matches;
}

std::vector<JudgedMatch> judge_loops(const pipeline::Dataset& drive,
                                     pipeline::LoopDetector& detector,
                                     const pipeline::TrueMatchRule& rule, bool deskew,
                                     const std::function<bool()>& stop,
                                     const std::function<void(int64_t, int64_t)>& done) {
  if (!drive.has_poses())
    throw UsageError(drive.name,
                     ": the scans have no poses, which the evaluation of matches needs");
  std::vector<JudgedMatch> matches;
  const auto scans = static_cast<int64_t>(drive.scans.size());
  recognize(stream_of(with_sensor_poses(drive)), detector, deskew, stop,
            [&, n = int64_t{0}](const Visit& visit) mutable {
              done(++n, scans);
              if (!visit.found.error.empty()) warn_left_out(visit.found.error);
              if (!visit.found.loop) return;
              const pipeline::Loop& loop = *visit.found.loop;
              const auto right = is_right(*visit.scan.pose, *loop.pose, rule);
              if (right) matches.push_back({{loop.score, *right}, false, *visit.scan.pose});
            });
  return matches;
}

std::vector<pipeline::LabeledScore> scores_by_place(std::span<const JudgedMatch> matches,
                                                    const pipeline::TrueMatchRule& rule) {
  std::array<std::vector<Eigen::Vector3d>, 2> places;  // of false matches, of true matches
  std::array<std::vector<double>, 2> counts;
  std::vector<size_t> place_of;
  for (const JudgedMatch& match : matches) {
    const size_t right = match.judged.correct ? 1 : 0;
    const Eigen::Vector3d here = match.pose.translation();
    const auto place = std::ranges::find_if(places[right], [&](const Eigen::Vector3d& p) {
      return rule.is_true(distance_between(p, here, rule.distance));
    });
    place_of.push_back(static_cast<size_t>(place - places[right].begin()));
    if (place == places[right].end()) {
      places[right].push_back(here);
      counts[right].push_back(0);
    }
    ++counts[right][place_of.back()];
  }
  std::vector<pipeline::LabeledScore> scores;
  for (size_t i = 0; i < matches.size(); ++i) {
    scores.push_back(matches[i].judged);
    scores.back().weight = 1 / counts[matches[i].judged.correct ? 1 : 0][place_of[i]];
  }
  return scores;
}

pipeline::TrueMatchRule rule_of(double radius) {
  if (!(radius > 0)) throw UsageError("--radius: expected a positive number, found ", radius);
  return {.radius = radius, .false_beyond = 2 * radius};
}

}  // namespace revisit::cli
