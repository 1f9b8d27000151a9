#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>
#include <iterator>

#include "cli/command.h"
#include "cli/terminal.h"
#include "eval/feature_options.h"
#include "loops/labeled_matches.h"
#include "revisit/base/files.h"
#include "revisit/recognition/ring/descriptor.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

constexpr double kLeastShare = 1e-6;  // of correct matches
constexpr double kMatchPrior = 0.1;   // fraction of correct matches in use; KITTI 08 has 0.08

struct CalibrateOptions {
  fs::path model, weights, output;
  std::vector<fs::path> drives;
  std::string exclusion = to_string(Exclusion()), every = "1";
  int augmentations = 1;
  uint32_t seed = 1;
  double radius = 5, precision = default_target_precision(Score::kDistinctMargin);
  bool evaluate = false;
  FeatureOptions running;  // only threads, progress and sequence

  void declare(Options& options);
};

void CalibrateOptions::declare(Options& options) {
  options.argument("MODEL", &model)
      .argument("DRIVE", &drives)
      .option("output", "FILE", "file of the calibrated model (default: MODEL)", &output, 'o')
      .excludes({"evaluate"})
      .flag("evaluate", "evaluation of the model's calibration on these drives; nothing is written",
            &evaluate)
      .group("Data:")
      .option("sequence", "NAME",
              "sequence of a data set that has several (00, scene-0061, Ouster); topic of a bag",
              &running.sequence)
      .option("every", "N[,...]",
              "frame stride; several strides evaluate every drive at each of them (default 1)",
              &every)
      .group("Matches:")
      .option("exclusion", "KIND=N",
              str("recent scans that are not compared: meters=30, frames=50, seconds=30 or none "
                  "(default ",
                  exclusion, ")"),
              &exclusion)
      .option("radius", "METERS",
              "maximum distance of a correct match; incorrect beyond twice that (default 5)",
              &radius)
      .option("augment", "N", "perturbed copies of every scan, as further queries (default 1)",
              &augmentations)
      .at_least(0)
      .option("seed", "N", "seed of the perturbations (default 1)", &seed)
      .option("target-precision", "P",
              str("fraction of accepted matches that are correct, for the table (default ",
                  precision, ")"),
              &precision)
      .between(kLeastShare, 1 - kLeastShare)
      .group("Network:")
      .option("weights", "W", "caffemodel, if the model does not hold it", &weights);
  running.declare_threads(options);
}

std::vector<int> strides_of(const CalibrateOptions& o) {
  std::vector<int> strides;
  for (const std::string& one : comma_separated(o.every))
    strides.push_back(parse_value<int>("--every", one));
  if (strides.empty() || std::ranges::min(strides) < 1)
    throw UsageError("--every: expected numbers of at least 1, found '", o.every, "'");
  return strides;
}

/// Matches of each drive. At each of its strides the map is empty at the start.
std::vector<std::vector<LabeledMatch>> matches_of_drives(const CalibrateOptions& o,
                                                         const std::vector<Dataset>& drives,
                                                         const FeatureExtractor& rings, Score score,
                                                         int64_t& skipped) {
  const std::vector<int> strides = strides_of(o);
  LabelingOptions how{.exclusion = parse_exclusion(o.exclusion),
                      .augmentations = o.augmentations,
                      .seed = uint64_t{o.seed} << 32,
                      .skipped = &skipped};
  std::vector<std::vector<LabeledMatch>> all;
  const Observer observer = o.running.observer();
  for (Dataset drive : drives) {
    all.emplace_back();
    how.rule = rule_of(o.radius, drive);
    const std::vector<ScanRef> scans = std::move(drive.scans);
    for (const int every : strides) {
      drive.scans.clear();
      std::ranges::copy_if(scans, std::back_inserter(drive.scans),
                           [&](const ScanRef& scan) { return scan.frame % every == 0; });
      Map map(rings, {.score = score});
      how.done = observer.stage("evaluating", "scans");
      const std::vector<LabeledMatch> matches = labeled_matches(drive, map, how);
      all.back().insert(all.back().end(), matches.begin(), matches.end());
      how.seed += uint64_t{1} << 24;  // more seeds than a drive has scans
    }
  }
  return all;
}

std::vector<LabeledScore> scores_of(const std::vector<LabeledMatch>& matches,
                                    std::optional<bool> perturbed = std::nullopt) {
  std::vector<LabeledScore> scores;
  for (const LabeledMatch& match : matches)
    if (!perturbed || match.perturbed == *perturbed) scores.push_back(match.score);
  return scores;
}

/// Predicted and observed probabilities in the non-empty tenths of [0, 1].
Table reliability(const Calibration& calibration, const std::vector<LabeledScore>& scores) {
  struct Bin {
    double predicted = 0, observed = 0, matches = 0;
  };
  constexpr int kBins = 10;
  std::array<Bin, kBins> bins;
  for (const LabeledScore& match : scores) {
    const double p = calibration.probability(match.score);
    Bin& bin = bins[static_cast<size_t>(std::min(p * kBins, kBins - 1.0))];
    bin.predicted += p;
    bin.observed += match.correct ? 1 : 0;
    ++bin.matches;
  }
  Table table({"predicted", "observed", "matches"});
  for (const Bin& bin : bins)
    if (bin.matches > 0)
      table.row({number(bin.predicted / bin.matches, 3), number(bin.observed / bin.matches, 3),
                 number(bin.matches, 0)});
  return table;
}

void print(const Calibration& calibration, const std::vector<LabeledMatch>& matches,
           double precision) {
  const std::optional<double> threshold = calibration.threshold_for(precision);
  Table table({"scans", "matches", "correct", "Brier", "accepted", "incorrect"});
  for (const auto& [name, perturbed] :
       {std::pair("unperturbed", false), std::pair("perturbed", true)}) {
    const std::vector<LabeledScore> scores = scores_of(matches, perturbed);
    if (scores.empty()) continue;
    int64_t correct = 0, accepted = 0, incorrect = 0;
    double squares = 0;  // of p - correct
    for (const LabeledScore& match : scores) {
      const bool is_accepted = threshold && match.score >= *threshold;
      correct += match.correct ? 1 : 0;
      accepted += is_accepted ? 1 : 0;
      incorrect += is_accepted && !match.correct ? 1 : 0;
      squares += std::pow(calibration.probability(match.score) - (match.correct ? 1 : 0), 2);
    }
    table.row({name, str(scores.size()), str(correct),
               number(squares / static_cast<double>(scores.size()), 4), str(accepted),
               str(incorrect)});
  }
  table.print(std::cout);
  std::cout << "\n";
  reliability(calibration, scores_of(matches)).print(std::cout);
  if (threshold)
    std::cout << "\nthreshold for precision " << precision << ": score " << number(*threshold, 4)
              << "\n";
  else
    std::cout << "\nno threshold reaches precision " << precision << "; the best is "
              << number(calibration.max_precision(), 4) << "\n";
}

int calibrate(const CalibrateOptions& o) {
  const fs::path& output = o.output.empty() ? o.model : o.output;
  if (!o.evaluate) check_target(output);  // first, because the evaluation may take hours
  RingModel model = read_ring_model(o.model);
  if (o.evaluate && !model.calibration)
    throw InputError(o.model.string() +
                     ": the model has no calibration to evaluate; calibrate it first");
  const FeatureExtractor rings =
      ring_recognizer(model, ring_net(model, o.weights), {}, {.threads = o.running.thread_count()});
  std::vector<Dataset> drives;
  for (const fs::path& data : o.drives)
    drives.push_back(open_drive(o.running, data, model.sensor, true));
  const std::string names = names_of(drives) + (o.every == "1" ? "" : ", every " + o.every);
  int64_t skipped = 0;
  const Score score = o.evaluate ? model.calibration->score : Score::kDistinctMargin;
  const auto of_drives = matches_of_drives(o, drives, rings, score, skipped);
  std::vector<LabeledMatch> matches;
  for (const std::vector<LabeledMatch>& drive : of_drives)
    matches.insert(matches.end(), drive.begin(), drive.end());
  if (matches.empty() ||
      (!o.evaluate && std::ranges::none_of(scores_of(matches), &LabeledScore::correct)))
    throw InputError(names, ": no match is ", matches.empty() ? "correct or incorrect" : "correct",
                     "; give drives with revisits, or a smaller --exclusion");
  if (!o.evaluate) {
    std::vector<std::vector<LabeledScore>> scores;
    for (size_t i = 0; i < drives.size(); ++i)
      scores.push_back(scores_by_place(of_drives[i], rule_of(o.radius, drives[i])));
    model.calibration = calibrate_leave_one_out(scores, kMatchPrior);
    model.calibration->score = score;
    model.calibration->radius = o.radius;
    model.calibration->negative_radius = rule_of(o.radius, drives[0]).negative_radius;
    model.calibration->trained_on = names;
    write_ring_model(output, model);
  }
  print(*model.calibration, matches, o.precision);
  return skipped > 0 ? kScansSkipped : kOk;
}

}  // namespace

Command calibrate_command() {
  return {"calibrate", "calibrate the scores of a ring model",
          "Estimates the probability that a match is correct from its score, on drives with poses "
          "that the ring model was not trained on, and stores this calibration in the model for "
          "`revisit loops`. Every scan is a query against the scans before it, unperturbed and "
          "perturbed at random (tilt, hidden sectors, shorter range). Each place counts once. The "
          "calibration is conservative: it holds if any one of the drives is left out.",
          "  revisit calibrate hdl64.ring town1 town2 village\n"
          "  revisit calibrate hdl64.ring town3 --evaluate     # reliability in another town\n",
          with_options<CalibrateOptions>(calibrate)};
}

}  // namespace revisit::cli
