#include <algorithm>
#include <fstream>
#include <iostream>

#include "cli/built_in.h"
#include "cli/command.h"
#include "cli/interrupt.h"
#include "cli/messages.h"
#include "cli/progress.h"
#include "cli/table.h"
#include "loops/judge_drive.h"
#include "loops/loop_writer.h"
#include "loops/map_options.h"
#include "loops/pose_options.h"
#include "loops/recognise.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/loops/loop_summary.h"
#include "revisit/loops/pose_files.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// Of up to a million places these had all that every heading finds, and 995 of 1000 of the four
/// best, which the score is made of (docs/SPEED.md).
constexpr int64_t kCandidates = 1000;

struct LoopsOptions {
  FeatureOptions feature;
  MapOptions map;
  PoseOptions poses;
  fs::path output, g2o, tum;
  std::string format = "csv";
  pipeline::Exclusion exclusion;
  pipeline::KeyframeRule keyframes;
  std::optional<double> threshold;
  fs::path calibrate;
  std::string calibrate_sequence;
  std::optional<double> sure;
  double radius = 5;
  int k = pipeline::RecognizerOptions().k;
  int64_t graph_candidates = 0;
  std::optional<double> follow;
  std::optional<bool> verify;
  double local_map = 0;
  bool all = false, no_deskew = false;
};

LoopsOptions parse_loops_options(const Arguments& arguments, Parser& parser) {
  LoopsOptions o;
  bool verify = false, no_verify = false;
  std::string exclusion = to_string(o.exclusion), keyframes = "all";
  o.feature.feature = "ring";
  o.feature.ring_key_candidates = kCandidates;
  o.feature.declare(parser, Scans::kOneByOne);
  parser.group("Loops:")
      .option("exclusion", "KIND=N",
              "recent scans of this drive that are not compared: frames=50 (default), seconds=30, "
              "metres=50 or none",
              &exclusion)
      .option("keyframes", "RULE",
              "which scans are stored; all are compared: all (default), metres=1 (by poses) or "
              "similarity=0.9 (less similar to the last one stored)",
              &keyframes)
      .option("threshold", "S",
              "a loop is accepted from this score on: the similarity plus the share of inliers of "
              "a registered one (default: from where --sure is reached)",
              &o.threshold)
      .option("sure", "P",
              "the share of accepted loops that are to be right, 0 to 1, as far as the "
              "calibration holds: the map's, or the program's (default 0.99, or 0.95 of loops that "
              "are not registered)",
              &o.sure)
      .option("calibrate", "DRIVE",
              "adapt the calibration to the matches of this drive with poses, and keep it in the "
              "map",
              &o.calibrate)
      .option("calibrate-sequence", "NN", "sequence of DRIVE when it is a KITTI root",
              &o.calibrate_sequence)
      .option("radius", "METRES",
              "for --calibrate: a match nearer than this is right, one twice as far wrong (default "
              "5)",
              &o.radius)
      .flag("no-verify",
            "do not register the most similar places. By default GICP says where the scan was, and "
            "how sure that is; how well points fit counts as much as the similarity",
            &no_verify)
      .flag("verify", "register places also where that is not the default: an error without rings",
            &verify)
      .option("local-map", "METRES",
              "describe and register what was seen on the last METRES by the poses, 1 to 200, "
              "instead of a scan alone: for sensors with a gap, or few points; with 10 m it "
              "is the best on a real drive. The ring model is then hdl64's, unless --sensor says "
              "another",
              &o.local_map)
      .option("k", "K", "similarities that a match must stand out from (default 4)", &o.k)
      .option("graph-candidates", "N",
              "for maps of more than about 100,000 places of a feature compared by cosine: compare "
              "only this many, which a graph proposes (FAISS); rings need none",
              &o.graph_candidates)
      .flag("all", "a line for every scan, not only for accepted loops", &o.all)
      .option("follow", "SECONDS",
              "DATA is a folder that grows: continue until no scan has come for this long",
              &o.follow);
  o.map.declare(parser);
  o.poses.declare(parser);
  parser.flag(
      "no-deskew",
      "leave in points what the motion during a scan did to them. By default it is taken out "
      "where scans have times, poses, and a field with the times of points",
      &o.no_deskew);
  parser.group("Output:")
      .choice("format", {"csv", "jsonl"}, "one line per loop (default csv)", &o.format)
      .option("output", "FILE", "for the loops (default: standard output)", &o.output, 'o')
      .option("g2o", "FILE", "a pose graph: poses, and registered loops", &o.g2o)
      .option("tum", "FILE",
              "a trajectory: where registered loops say that the sensor was, in the frame of the "
              "places' poses",
              &o.tum);
  parser.parse(arguments);
  o.exclusion = pipeline::parse_exclusion(exclusion);
  o.keyframes = pipeline::parse_keyframes(keyframes);
  o.feature.check_given(parser);
  if (o.sure && !(*o.sure > 0 && *o.sure < 1))
    throw UsageError("--sure: expected more than 0, less than 1, found ", *o.sure);
  for (const char* option : {"calibrate", "sure"})
    if (o.threshold && parser.given(option))
      throw UsageError("--threshold and --", option, ": one of the two");
  if (o.follow && !(*o.follow > 0))
    throw UsageError("--follow: expected a positive number, found ", *o.follow);
  o.map.check();
  o.poses.check(parser);
  if (!o.poses.file.empty() && (o.follow || o.feature.data == "-"))
    throw UsageError("--poses: of a drive that is complete, not with ",
                     o.follow ? "--follow" : "a list of scans");
  if (o.graph_candidates > 0) need_built_in("--graph-candidates", "FAISS");
  const char* const needs = verify           ? "--verify"
                            : !o.g2o.empty() ? "--g2o"
                            : !o.tum.empty() ? "--tum"
                                             : nullptr;
  const char* const against = no_verify ? "--no-verify" : o.map.no_clouds ? "--no-clouds" : nullptr;
  if (needs != nullptr && against != nullptr)
    throw UsageError(against, ": ", needs, " needs registered loops; give one of the two");
  if (needs != nullptr || no_verify) o.verify = needs != nullptr;
  return o;
}

/// The stream with `first` in front.
ScanStream with(std::vector<pipeline::ScanRef> first, ScanStream rest) {
  return [first = stream_of(std::move(first)), rest = std::move(rest)] {
    const std::optional<pipeline::ScanRef> scan = first();
    return scan ? scan : rest();
  };
}

/// The first scans of a stream up to one that can be read, which shows the sensor.
std::vector<pipeline::ScanRef> first_readable(const ScanStream& stream) {
  constexpr size_t kTried = 20;
  std::vector<pipeline::ScanRef> scans;
  while (scans.size() < kTried) {
    const std::optional<pipeline::ScanRef> scan = stream();
    if (!scan) break;
    scans.push_back(*scan);
    try {
      if (std::ranges::any_of(pipeline::read_scan(scan->file).points, pipeline::is_return)) break;
    } catch (const InputError&) {  // named when its turn comes
    }
  }
  return scans;
}

/// The scans asked for, and some of them that show the sensor.
struct Source {
  ScanStream stream;
  pipeline::Dataset some;
};

/// Throws UsageError when the first scan shows that --local-map cannot be.
void check_poses(const LoopsOptions& o, const std::vector<pipeline::ScanRef>& scans) {
  if (o.local_map != 0 && !scans.front().pose)
    throw UsageError("--local-map: ", scans.front().file.string(), " has no pose; give --poses");
}

/// The model of local maps of any sensor (docs/RESULTS.md), or the map's.
void choose_local_map_sensor(LoopsOptions& o) {
  if (o.local_map == 0 || o.feature.feature != "ring" || !o.feature.ring.empty() ||
      !o.feature.image.is_auto())
    return;
  const std::string of_map = pipeline::shipped_ring_sensor(pipeline::maker_of(o.map.file));
  o.feature.image.sensor = of_map.empty() ? "hdl64" : of_map;
  if (!o.feature.quiet)
    note(str("sensor: ", o.feature.image.sensor,
             of_map.empty() ? " (of local maps)" : " (of the map)"));
}

/// Bags and packets are for the Python package.
void must_not_be_a_recording(const fs::path& data) {
  std::error_code error;
  if (fs::is_regular_file(data, error) || fs::exists(data / "metadata.yaml", error))
    throw InputError(data.string(),
                     ": expected a folder of scans; `revisit-loops` of the Python package reads "
                     "bags and packets");
}

Source open_source(const LoopsOptions& o) {
  must_not_be_a_recording(o.feature.data);
  if (o.feature.data != "-" && !o.follow) {
    pipeline::Dataset dataset = open_scans(o.feature);
    const std::vector<pipeline::ScanRef> scans = o.poses.scans_of(dataset);
    check_poses(o, scans);
    return {stream_of(scans), dataset};
  }
  // With the name and sequence of the last look that found the drive in order.
  const auto some = std::make_shared<pipeline::Dataset>();
  const auto so_far = [feature = o.feature, some] { return *some = scans_so_far(feature); };
  ScanStream stream =
      o.follow ? scans_coming(so_far, *o.follow, interrupted) : scans_listed_in(std::cin);
  const std::vector<pipeline::ScanRef> first = first_readable(stream);
  if (first.empty()) throw InputError(o.feature.data.string() + ": there are no scans");
  check_poses(o, first);
  some->scans = {first.back()};
  return {with(first, stream), *some};
}

pipeline::LoopDetectorOptions detector_options(const LoopsOptions& o) {
  pipeline::LoopDetectorOptions options{.exclusion = o.exclusion,
                                        .keyframes = o.keyframes,
                                        .verify = o.verify,
                                        .threshold = o.threshold,
                                        .keep_clouds = !o.map.no_clouds,
                                        .local_map = o.local_map};
  if (o.sure) options.precision = *o.sure;
  return options;
}

/// The calibration that holds without one of the map's, adapted to a drive whose poses are known;
/// of that drive alone for a feature without one.
pipeline::Calibration calibrated(const LoopsOptions& o, const RecognizerSource& source,
                                 const std::string& sensor) {
  FeatureOptions there = o.feature;
  there.data = o.calibrate;
  there.sequence = o.calibrate_sequence;
  const pipeline::Dataset dataset = open_scans(there, {.poses = true});
  if (!o.feature.quiet) warn_of_other_sensor(dataset, sensor);
  pipeline::PlaceRecognizer recognizer(source.extractor, source.options);
  pipeline::LoopDetector detector(recognizer, detector_options(o));
  cli::Progress progress("calibrating", "scans", !o.feature.no_progress && !o.feature.quiet);
  const pipeline::TrueMatchRule rule = rule_of(o.radius);
  const std::vector<pipeline::JudgedScore> matches = scores_by_place(
      judge_loops(dataset, detector, rule, !o.no_deskew, interrupted, progress.callback()), rule);
  if (std::ranges::none_of(matches, &pipeline::JudgedScore::right))
    throw InputError(o.calibrate.string() +
                     ": no match on it is right; it needs places that are seen again");
  const std::optional<pipeline::Calibration> before = detector.calibration();
  pipeline::Calibration calibration =
      before ? refined(*before, matches) : pipeline::isotonic_calibration(matches);
  calibration.k = source.options.k;
  calibration.score = detector.score();
  calibration.radius = rule.radius;
  calibration.wrong_beyond = rule.false_beyond;
  calibration.learnt_from = (before ? before->learnt_from + ", and " : "") + dataset.name;
  return calibration;
}

/// Throws UsageError, naming what is calibrated, when it does not promise the precision.
void need_promise(const pipeline::Calibration& calibration, const LoopsOptions& o) {
  const double precision = o.sure.value_or(calibration.score == pipeline::Score::kVerified
                                               ? pipeline::LoopDetectorOptions().precision
                                               : pipeline::RecognizerOptions().precision);
  if (!calibration.threshold_for(precision))
    throw UsageError("--sure ", precision, o.sure ? "" : " (the default)", ": learnt from ",
                     calibration.learnt_from, ", the calibration promises at most ",
                     number(calibration.highest_precision(), 5),
                     "; ask for less, --calibrate on a longer drive, or give --threshold");
}

/// What a scan took, for people.
void print_latencies(std::vector<double> milliseconds, int64_t places) {
  if (milliseconds.empty()) return;
  const std::vector<double> last(
      milliseconds.end() - static_cast<int64_t>(milliseconds.size() / 10), milliseconds.end());
  Table table({"ms a scan", "p50", "p95", "p99", "max"});
  const auto row = [&](const std::string& name, std::vector<double> values) {
    if (values.empty()) return;
    std::ranges::sort(values);
    const auto at = [&](double share) {
      return number(values[static_cast<size_t>(share * static_cast<double>(values.size() - 1))], 1);
    };
    table.row({name, at(0.5), at(0.95), at(0.99), at(1)});
  };
  row("all", std::move(milliseconds));
  row(str("the last tenth, of ", places, " places"), last);
  table.print(std::cerr);
}

}  // namespace

int loops_command(const Arguments& arguments) {
  if (lists_sensors(arguments)) return kOk;
  Parser parser(
      "revisit loops", "DATA|-",
      "Places seen before, found online: every scan is described, compared with what was there "
      "before it, printed as a line when it is recognised, and added. DATA is a KITTI sequence or "
      "a folder of scans; - takes names of scan files from standard input, a line each.",
      "  revisit loops town --calibrate other_town > loops.csv\n"
      "  revisit loops town --map town.map --calibrate other_town --g2o town.g2o\n"
      "  revisit loops recording/ --follow 10 --map town.map --format jsonl\n");
  LoopsOptions o = parse_loops_options(arguments, parser);
  const Source source = open_source(o);
  choose_local_map_sensor(o);
  RecognizerSource described = recognizer_source(o.feature, source.some, o.map.file);
  described.options.threshold = o.threshold;  // of the detector, where it verifies
  described.options.first_stretch = o.map.first_stretch;
  described.options.k = o.k;
  described.options.local_map = o.local_map;
  described.options.graph_candidates = o.graph_candidates;
  if (!o.verify) o.verify = described.extractor.comparison.turn && !o.map.no_clouds;
  if (o.sure) described.options.precision = *o.sure;
  const NewMap new_map(o.map.file);
  auto map = o.map.open(described);  // before the work of calibrating
  std::optional<pipeline::Calibration> learnt;
  if (!o.calibrate.empty()) {
    learnt = calibrated(o, described, sensor_of(source.some));
    need_promise(*learnt, o);
  }
  pipeline::PlaceRecognizer recognizer(described.extractor, described.options, std::move(map),
                                       warn);
  if (learnt) recognizer.calibrate(*learnt);
  const std::string drive = o.map.drive_of(source.some);
  pipeline::LoopDetectorOptions options = detector_options(o);
  options.drive = drive;
  pipeline::LoopDetector detector(recognizer, options);
  if (detector.verifies() && !o.threshold && recognizer.is_calibrated() &&
      !recognizer.verified_calibration())
    warn(
        "the map's threshold or calibration is of loops that are not registered, and left aside: "
        "--calibrate DRIVE again, or --no-verify");
  if (!detector.threshold()) {
    if (const auto calibration = detector.calibration()) need_promise(*calibration, o);
    if (parser.given("sure"))
      throw UsageError("--sure: this feature is not calibrated; add --calibrate DRIVE");
    if (!o.all && !o.feature.quiet)
      note("no threshold: every scan is printed; --calibrate DRIVE learns one");
  } else if (!o.threshold && !o.feature.quiet) {
    note(str("loops are accepted from the score ", number(*detector.threshold(), 3), " on"));
  }
  const bool all = o.all || !detector.threshold();

  std::ofstream file;
  if (!o.output.empty()) {
    file.open(o.output);
    if (!file) throw Error(o.output.string() + ": cannot be written");
  }
  LoopWriter writer(o.output.empty() ? std::cout : file, o.format);
  std::optional<pipeline::PoseGraphWriter> graph;
  if (!o.g2o.empty()) graph.emplace(o.g2o);
  std::optional<pipeline::TrajectoryWriter> trajectory;
  if (!o.tum.empty()) trajectory.emplace(o.tum);
  std::vector<double> milliseconds;
  pipeline::LoopSummary summary(o.exclusion, detector.threshold());
  int64_t trajectory_poses = 0, poses = 0, not_in_graph = 0;
  cli::Progress progress("recognising", "scans", !o.feature.no_progress && !o.feature.quiet);
  const auto total = static_cast<int64_t>(source.some.scans.size());
  recognise(source.stream, detector, !o.no_deskew, interrupted, [&](const Visit& visit) {
    const pipeline::Detection& found = visit.found;
    summary.add(found);
    progress.update(summary.scans(), std::max(summary.scans(), total));
    if (!found.why_not.empty()) {
      warn_left_out(found.why_not);
      return;
    }
    milliseconds.push_back(visit.milliseconds);
    poses += visit.scan.pose ? 1 : 0;
    const bool registered = found.registered && found.registered->accepted;
    if (graph && registered && !found.position) ++not_in_graph;
    if (graph && found.position) {
      graph->vertex(*found.position, o.poses.as_given(visit.scan.pose));
      if (registered) {
        graph->known_vertex(found.loop->position, o.poses.as_given(found.loop->pose));
        graph->edge(found.loop->position, *found.position, found.registered->T_place_query,
                    found.registered->information);
      }
    }
    if (trajectory && registered && found.loop->pose) {
      trajectory->add(visit.scan.time.value_or(static_cast<double>(visit.scan.frame)),
                      o.poses.as_given(*found.loop->pose * found.registered->T_place_query));
      ++trajectory_poses;
    }
    if ((found.loop && found.loop->accepted) || all) writer.write(line_of(visit, detector.drive()));
  });
  if (!o.feature.quiet) {
    if (detector.drive() != drive)
      note(
          str("the map has another recording '", drive, "'; this one is '", detector.drive(), "'"));
    std::cerr << summary.text() << ", " << recognizer.size() << " places known\n";
    if (trajectory && trajectory_poses == 0)
      warn(o.tum.string() + ": empty: no loop was registered to a place with a pose");
    if (not_in_graph > 0)
      warn(str(o.g2o.string(), ": without ", not_in_graph, " loops of scans that are not stored"));
    if (graph && poses == 0)
      warn(o.g2o.string() +
           ": the scans have no poses, so it has no edges from scan to scan, and all vertices are "
           "at the origin");
    print_latencies(std::move(milliseconds), recognizer.size());
  }
  return summary.left_out() > 0 ? kScansLeftOut : kOk;
}

}  // namespace revisit::cli
