#include <algorithm>
#include <deque>
#include <iostream>

#include "cli/command.h"
#include "cli/interrupt.h"
#include "cli/messages.h"
#include "cli/table.h"
#include "eval/feature_options.h"
#include "loops/judge_drive.h"
#include "revisit/recognition/ring/features.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;
using pipeline::Calibration;
using pipeline::JudgedScore;

struct CalibrateOptions {
  fs::path model, weights, output;
  std::vector<fs::path> drives;
  std::string sequence, exclusion = "frames=50";
  std::string every = "1";
  int altered = 1;
  uint32_t seed = 1;
  double radius = 5, right_share = 0.1, precision = pipeline::RecognizerOptions().precision;
  bool judge = false;
  FeatureOptions running;  // of these only how it runs, and which scans of a drive
};

CalibrateOptions parse_calibrate_options(const Arguments& arguments) {
  CalibrateOptions o;
  Parser parser(
      "revisit calibrate", "MODEL DRIVE...",
      "Learns how likely a match with some score is right, on drives with poses that the ring "
      "model "
      "was not learnt from, and keeps it in the model. `revisit loops` then accepts matches by it. "
      "Every scan is asked among those before it, once as it is and once altered at random, as "
      "robots alter scans: tilted, hidden in part, seen less far. A place counts once, however "
      "often it is asked, and what holds without each of the drives is promised.",
      "  revisit calibrate hdl64.ring town1 town2 village\n"
      "  revisit calibrate hdl64.ring town3 --judge     # how well that holds in another town\n");
  parser.positional("MODEL", &o.model)
      .optional_positional("DRIVE", &o.drives)
      .option("output", "FILE", "where the model goes (default: MODEL)", &o.output, 'o')
      .flag("judge", "learn nothing: say how well the model's calibration holds on these drives",
            &o.judge)
      .group("Data:")
      .option("sequence", "NN", "sequence of KITTI roots (not needed when there is one)",
              &o.sequence)
      .option(
          "every", "N[,...]",
          "only frames whose number is a multiple of N (default 1: all); of several N all drives "
          "are judged at each of these spacings",
          &o.every)
      .group("Matches:")
      .option("exclusion", "KIND=N",
              "recent scans that are not compared: frames=50 (default), seconds=30, metres=50 or "
              "none",
              &o.exclusion)
      .option("radius", "METRES",
              "a match nearer than this is right, one twice as far wrong (default 5)", &o.radius)
      .option("right-share", "P",
              "the share of matches that are right where the model will be used: the less often a "
              "robot comes back, the more mistakes count (default 0.1; KITTI's route 08 has 0.08)",
              &o.right_share)
      .option("altered", "N", "altered copies of every scan that are asked, too (default 1)",
              &o.altered)
      .option("seed", "S", "of the alterations (default 1)", &o.seed)
      .option("sure", "P",
              "the share of accepted matches that are to be right, for the table (default 0.99)",
              &o.precision)
      .group("Network:")
      .option("weights", "W", "caffemodel, of a model that does not carry it", &o.weights)
      .group("Running:")
      .option("threads", "N", "threads of one scan (default: all cores)", &o.running.threads)
      .flag("no-progress", "no progress line", &o.running.no_progress)
      .flag("quiet", "only results and errors", &o.running.quiet, 'q');
  parser.parse(arguments);
  if (o.drives.empty()) throw UsageError("give at least one drive with poses: DRIVE");
  if (o.judge && !o.output.empty())
    throw UsageError("--judge and --output: one of the two, --judge writes nothing");
  for (const auto& [option, share] :
       {std::pair("--right-share", o.right_share), std::pair("--sure", o.precision)}) {
    constexpr double kLeast = 1e-6;
    if (!(share >= kLeast && share <= 1 - kLeast))
      throw UsageError(option, ": expected 0.000001 to 0.999999, found ", share);
  }
  if (o.altered < 0) throw UsageError("--altered: expected at least 0, found ", o.altered);
  return o;
}

std::vector<int> spacings_of(const CalibrateOptions& o) {
  std::vector<int> spacings;
  for (const std::string& one : comma_separated(o.every))
    spacings.push_back(parse_value<int>("--every", one));
  if (spacings.empty() || std::ranges::min(spacings) < 1)
    throw UsageError("--every: expected numbers of at least 1, found '", o.every, "'");
  return spacings;
}

/// The matches of each drive, which is recognised by itself.
std::vector<std::vector<JudgedMatch>> judged(const CalibrateOptions& o, const std::string& sensor,
                                             const pipeline::FeatureExtractor& rings,
                                             pipeline::Score score, std::string& names,
                                             int64_t& left_out) {
  const std::vector<int> spacings = spacings_of(o);
  JudgeDrive how;
  how.exclusion = pipeline::parse_exclusion(o.exclusion);
  how.rule = rule_of(o.radius);
  how.altered = o.altered;
  how.seed = uint64_t{o.seed} << 32;
  how.left_out = [&left_out](const std::string& why) {
    ++left_out;
    warn_left_out(why);
  };
  how.stop = interrupted;
  std::vector<std::vector<JudgedMatch>> all;
  const pipeline::Observer observer = o.running.observer();
  for (const fs::path& data : o.drives) {
    FeatureOptions options = o.running;
    options.data = data;
    options.sequence = o.sequence;
    const pipeline::Dataset drive = open_scans(options, {.poses = true});
    if (!o.running.quiet) warn_of_other_sensor(drive, sensor);
    std::deque<pipeline::PlaceRecognizer> recognizers;
    std::vector<SpacedRecognizer> spaced;
    for (const int every : spacings)
      spaced.push_back(
          {&recognizers.emplace_back(rings, pipeline::RecognizerOptions{.score = score}), every});
    how.done = observer.stage("judging", "scans");
    all.push_back(judge_drive(drive, spaced, how));
    how.seed += uint64_t{1} << 24;  // more than a drive has scans
    names += str(names.empty() ? "" : ", ", drive.scans.size(), " scans of ", drive.name,
                 drive.sequence.empty() ? "" : "/" + drive.sequence);
  }
  if (o.every != "1") names += ", every " + o.every;
  return all;
}

std::vector<JudgedScore> scores_of(const std::vector<JudgedMatch>& matches,
                                   std::optional<bool> altered = std::nullopt) {
  std::vector<JudgedScore> scores;
  for (const JudgedMatch& match : matches)
    if (!altered || match.altered == *altered) scores.push_back(match.judged);
  return scores;
}

void print(const Calibration& calibration, const std::vector<JudgedMatch>& matches,
           double precision) {
  const std::optional<double> threshold = calibration.threshold_for(precision);
  Table table({"scans", "matches", "right", "Brier", "accepted", "wrong"});
  for (const auto& [name, altered] :
       {std::pair("as they are", false), std::pair("altered", true)}) {
    const std::vector<JudgedScore> scores = scores_of(matches, altered);
    if (scores.empty()) continue;
    int64_t right = 0, accepted = 0, wrong = 0;
    for (const JudgedScore& match : scores) {
      const bool is_accepted = threshold && match.score >= *threshold;
      right += match.right ? 1 : 0;
      accepted += is_accepted ? 1 : 0;
      wrong += is_accepted && !match.right ? 1 : 0;
    }
    table.row({name, str(scores.size()), str(right), number(brier_score(calibration, scores), 4),
               str(accepted), str(wrong)});
  }
  table.print(std::cout);
  std::cout << "\n";
  Table bins({"predicted", "observed", "matches"});
  for (const pipeline::ReliabilityBin& bin : reliability(calibration, scores_of(matches)))
    bins.row({number(bin.predicted, 3), number(bin.observed, 3), str(bin.matches)});
  bins.print(std::cout);
  if (threshold)
    std::cout << "\nprecision " << precision << " from the score " << number(*threshold, 4)
              << " on\n";
  else
    std::cout << "\nno score promises the precision " << precision << ", but "
              << number(calibration.highest_precision(), 4) << "\n";
}

}  // namespace

int calibrate_command(const Arguments& arguments) {
  const CalibrateOptions o = parse_calibrate_options(arguments);
  pipeline::RingModel model = pipeline::read_ring_model(o.model);
  if (o.judge && !model.calibration)
    throw InputError(o.model.string() + ": this model has no calibration to judge");
  const pipeline::FeatureExtractor rings = pipeline::ring_recogniser(
      model, pipeline::ring_net(model, o.weights), {}, {.threads = o.running.thread_count()});
  std::string names;
  int64_t left_out = 0;
  const pipeline::Score score =
      o.judge ? model.calibration->score : pipeline::Score::kDistinctMargin;
  const auto of_drives = judged(o, model.sensor, rings, score, names, left_out);
  std::vector<JudgedMatch> matches;
  for (const std::vector<JudgedMatch>& drive : of_drives)
    matches.insert(matches.end(), drive.begin(), drive.end());
  if (matches.empty() ||
      (!o.judge && std::ranges::none_of(scores_of(matches), &JudgedScore::right)))
    throw InputError(
        names, ": no match is ", matches.empty() ? "right or wrong" : "right",
        "; it takes drives with places that are seen again, and an --exclusion they allow");
  if (!o.judge) {
    const pipeline::TrueMatchRule rule = rule_of(o.radius);
    std::vector<std::vector<JudgedScore>> scores;
    for (const std::vector<JudgedMatch>& drive : of_drives)
      scores.push_back(scores_by_place(drive, rule));
    model.calibration = pipeline::calibration_of_drives(scores, o.right_share);
    model.calibration->score = score;
    model.calibration->radius = rule.radius;
    model.calibration->wrong_beyond = rule.false_beyond;
    model.calibration->learnt_from = names;
    write_ring_model(o.output.empty() ? o.model : o.output, model);
  }
  print(*model.calibration, matches, o.precision);
  return left_out > 0 ? kScansLeftOut : kOk;
}

}  // namespace revisit::cli
