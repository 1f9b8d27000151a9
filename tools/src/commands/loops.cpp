#include <algorithm>
#include <fstream>
#include <iostream>

#include "cli/built_in.h"
#include "cli/command.h"
#include "cli/interrupt.h"
#include "cli/messages.h"
#include "cli/progress.h"
#include "cli/table.h"
#include "loops/labeled_matches.h"
#include "loops/loop_writer.h"
#include "loops/map_options.h"
#include "loops/pose_options.h"
#include "loops/recognize.h"
#include "loops/recording.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/loops/loop_summary.h"
#include "revisit/loops/pose_files.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// Include every correct best match of an exhaustive comparison and all of the four best, which
/// make the score, in maps of up to a million entries (docs/SPEED.md).
constexpr int64_t kCandidates = 1000;

struct LoopsOptions {
  FeatureOptions feature;
  MapOptions map;
  PoseOptions poses;
  fs::path output, g2o, tum;
  std::string format = "csv";
  Exclusion exclusion;
  KeyframeRule keyframes;
  std::optional<double> threshold;
  fs::path calibrate;
  std::string calibrate_sequence;
  std::optional<double> sure;
  double radius = 5;
  int k = RecognizerOptions().k;
  int64_t hnsw_candidates = 0;
  std::optional<double> follow;
  std::optional<bool> verify;
  double local_map = 0;
  bool all = false, no_deskew = false, needs_verify = false, no_verify = false;
  std::string exclusion_text = to_string(exclusion), keyframes_text = "all";

  void declare(Options& options);

 private:
  void finish();
};

void LoopsOptions::declare(Options& options) {
  options.before_parsing([&options](const Arguments& arguments) {
    if (const fs::path recording = recording_in(arguments, options.rows()); !recording.empty())
      run_python_loops(recording, arguments);
  });
  feature.ring_key_candidates = kCandidates;
  feature.declare(options, Scans::kOneByOne);
  options.group("Loops:")
      .option("exclusion", "KIND=N",
              "recent scans of this drive that are not compared: frames=50, seconds=30, meters=50 "
              "or none "
              "(default frames=50)",
              &exclusion_text)
      .common()
      .option("keyframes", "RULE",
              "stored scans: all, meters=1 (by poses) or similarity=0.9 (to the last one stored); "
              "all are queries "
              "(default all)",
              &keyframes_text)
      .option("threshold", "S",
              "minimum score of an accepted loop: similarity plus inlier ratio if registered "
              "(default: from "
              "--target-precision)",
              &threshold)
      .excludes({"calibrate", "target-precision"})
      .common()
      .option("target-precision", "P",
              "fraction of accepted loops that are correct, 0 to 1, by the calibration of the map "
              "or the program "
              "(default 0.99, or 0.95 without registration)",
              &sure)
      .common()
      .option("calibrate", "DRIVE",
              "drive with poses whose matches refine the calibration, which the map keeps",
              &calibrate)
      .common()
      .option("calibrate-sequence", "NN", "sequence of DRIVE if it is a KITTI root",
              &calibrate_sequence)
      .option("radius", "METERS",
              "maximum distance of a correct match for --calibrate; incorrect beyond twice that "
              "(default 5)",
              &radius)
      .flag("no-verify",
            "no registration of candidates (default for ring descriptors: GICP estimates the "
            "relative pose and its "
            "information, and the inlier ratio adds to the score)",
            &no_verify)
      .excludes({"verify", "g2o", "tum"})
      .common()
      .flag("verify", "registration of candidates, or an error without ring descriptors",
            &needs_verify)
      .option("local-map", "METERS",
              "path length of the local map that replaces a scan, 1 to 200, for sensors with a gap "
              "or few points; "
              "needs poses; 10 is a good value; uses the model of hdl64 unless --sensor is given "
              "(default: the scan)",
              &local_map)
      .common()
      .option("k", "K", "rank of the similarity that the margin refers to (default 4)", &k)
      .option("hnsw-candidates", "N",
              "candidates from an HNSW graph (FAISS), for maps of over 100,000 entries of a "
              "feature compared by "
              "cosine, not for rings; 0: all entries (default 0)",
              &hnsw_candidates)
      .flag("all", "a line for every scan (default: only for accepted loops)", &all)
      .common()
      .option("follow", "SECONDS",
              "DATA is a folder that grows: end after this time without a new scan", &follow)
      .positive()
      .common();
  map.declare(options);
  poses.declare(options);
  options.flag(
      "no-deskew",
      "no motion compensation of scans (default: if scans have times, poses and times of points)",
      &no_deskew);
  options.group("Output:")
      .choice("format", {"csv", "jsonl"}, "format of the lines (default csv)", &format)
      .common()
      .option("output", "FILE", "file of the lines (default: standard output)", &output, 'o')
      .common()
      .option("g2o", "FILE", "pose graph of the poses and the registered loops", &g2o)
      .common()
      .option("tum", "FILE",
              "trajectory of the sensor from registered loops, in the frame of the map's poses",
              &tum)
      .common();
  options.check([this] { finish(); });
}

void LoopsOptions::finish() {
  exclusion = parse_exclusion(exclusion_text);
  keyframes = parse_keyframes(keyframes_text);
  if (sure && !(*sure > 0 && *sure < 1))
    throw UsageError("--target-precision: expected more than 0, less than 1, found ", *sure);
  if (!poses.file.empty() && (follow || feature.data == "-"))
    throw UsageError("--poses: not supported with ", follow ? "--follow" : "a list of scans");
  if (hnsw_candidates > 0) need_built_in("--hnsw-candidates", "FAISS");
  const char* const needs = needs_verify   ? "--verify"
                            : !g2o.empty() ? "--g2o"
                            : !tum.empty() ? "--tum"
                                           : nullptr;
  if (needs != nullptr && map.no_clouds)
    throw UsageError("--no-clouds: not with ", needs,
                     ", which needs registered loops; give one of the two");
  if (needs != nullptr || no_verify) verify = needs != nullptr;
}

ScanStream with(std::vector<ScanRef> first, ScanStream rest) {
  return [first = stream_of(std::move(first)), rest = std::move(rest)] {
    const std::optional<ScanRef> scan = first();
    return scan ? scan : rest();
  };
}

/// First scans of a stream up to a readable one, which shows the sensor.
std::vector<ScanRef> first_readable(const ScanStream& stream) {
  constexpr size_t kTried = 20;
  std::vector<ScanRef> scans;
  while (scans.size() < kTried) {
    const std::optional<ScanRef> scan = stream();
    if (!scan) break;
    scans.push_back(*scan);
    try {
      if (std::ranges::any_of(read_scan(scan->file).points, is_return)) break;
    } catch (const InputError&) {  // reported when the scan is read again
    }
  }
  return scans;
}

/// All scans, and some that show the sensor.
struct ScanSource {
  ScanStream stream;
  Dataset some;
};

void check_poses(const LoopsOptions& o, const std::vector<ScanRef>& scans) {
  if (o.local_map != 0 && !scans.front().pose)
    throw UsageError("--local-map: ", scans.front().file.string(), " has no pose; give --poses");
}

/// Chooses the model for local maps of any sensor (docs/SLAM.md), or the map's.
void choose_local_map_sensor(LoopsOptions& o) {
  if (o.local_map == 0 || o.feature.feature != "ring" || !o.feature.ring.empty() ||
      !o.feature.image.is_auto())
    return;
  const std::string of_map = shipped_ring_sensor(feature_key_of(o.map.file));
  o.feature.image.sensor = of_map.empty() ? "hdl64" : of_map;
  if (!o.feature.quiet)
    note(str("sensor: ", o.feature.image.sensor,
             of_map.empty() ? " (of local maps)" : " (of the map)"));
}

ScanSource open_source(const LoopsOptions& o) {
  if (std::error_code error; fs::is_regular_file(o.feature.data, error))
    throw InputError(o.feature.data.string(),
                     ": expected a folder of scans or a recording, found another file");
  if (o.feature.data != "-" && !o.follow) {
    Dataset dataset = open_scans(o.feature);
    const std::vector<ScanRef> scans = o.poses.scans_of(dataset);
    check_poses(o, scans);
    return {stream_of(scans), dataset};
  }
  // Holds name and sequence of the last look that succeeded.
  const auto some = std::make_shared<Dataset>();
  const auto so_far = [feature = o.feature, some] { return *some = scans_so_far(feature); };
  ScanStream stream =
      o.follow ? scans_coming(so_far, *o.follow, interrupted) : scans_listed_in(std::cin);
  const std::vector<ScanRef> first = first_readable(stream);
  if (first.empty()) throw InputError(o.feature.data.string() + ": there are no scans");
  check_poses(o, first);
  some->scans = {first.back()};
  return {with(first, stream), *some};
}

LoopDetectorOptions detector_options(const LoopsOptions& o) {
  LoopDetectorOptions options{.exclusion = o.exclusion,
                              .keyframes = o.keyframes,
                              .verify = o.verify,
                              .threshold = o.threshold,
                              .keep_clouds = !o.map.no_clouds,
                              .local_map = o.local_map};
  if (o.sure) options.target_precision = *o.sure;
  return options;
}

/// Refines the calibration of the feature, not the map's, on a drive with poses. If the feature has
/// none, uses that drive alone.
Calibration calibrated(const LoopsOptions& o, const RecognizerSource& source,
                       const std::string& sensor) {
  FeatureOptions there = o.feature;
  there.data = o.calibrate;
  there.sequence = o.calibrate_sequence;
  const Dataset dataset = open_scans(there, true);
  if (!o.feature.quiet) warn_of_other_sensor(dataset, sensor);
  PlaceRecognizer recognizer(source.extractor, source.options);
  LoopDetector detector(recognizer, detector_options(o));
  cli::Progress progress("calibrating", "scans", !o.feature.no_progress && !o.feature.quiet);
  const TrueMatchRule rule = rule_of(o.radius);
  const std::vector<LabeledScore> matches = scores_by_place(
      labeled_loops(dataset, detector, rule, !o.no_deskew, interrupted, progress.callback()), rule);
  if (std::ranges::none_of(matches, &LabeledScore::correct))
    throw InputError(
        o.calibrate.string() +
        ": no match is correct, so nothing can be calibrated; give a drive with revisits");
  const std::optional<Calibration> before = detector.calibration();
  Calibration calibration = before ? refined(*before, matches) : isotonic_calibration(matches);
  calibration.k = source.options.k;
  calibration.score = detector.score();
  calibration.radius = rule.radius;
  calibration.negative_radius = rule.false_beyond;
  calibration.trained_on = (before ? before->trained_on + ", and " : "") + dataset.name;
  return calibration;
}

void need_target_precision(const Calibration& calibration, const LoopsOptions& o) {
  const double precision =
      o.sure.value_or(calibration.score == Score::kVerified ? LoopDetectorOptions().target_precision
                                                            : RecognizerOptions().target_precision);
  if (!calibration.threshold_for(precision))
    throw UsageError("--target-precision ", precision, o.sure ? "" : " (the default)",
                     ": no threshold reaches it; the best precision of the calibration (from ",
                     calibration.trained_on, ") is ", number(calibration.max_precision(), 5),
                     "; give a lower one, a longer drive with --calibrate, or --threshold");
}

void print_latencies(std::vector<double> milliseconds, int64_t places) {
  if (milliseconds.empty()) return;
  const std::vector<double> last(
      milliseconds.end() - static_cast<int64_t>(milliseconds.size() / 10), milliseconds.end());
  Table table({"ms per scan", "p50", "p95", "p99", "max"});
  const auto row = [&](const std::string& name, std::vector<double> values) {
    if (values.empty()) return;
    std::ranges::sort(values);
    const auto at = [&](double share) {
      return number(values[static_cast<size_t>(share * static_cast<double>(values.size() - 1))], 1);
    };
    table.row({name, at(0.5), at(0.95), at(0.99), at(1)});
  };
  row("all", std::move(milliseconds));
  row(str("last tenth, ", places, " map entries"), last);
  table.print(std::cerr);
}

int detect_loops(LoopsOptions& o, const Options& options) {
  const ScanSource source = open_source(o);
  choose_local_map_sensor(o);
  RecognizerSource described = recognizer_source(o.feature, source.some, o.map.file);
  described.options.threshold = o.threshold;  // the detector has its own if it verifies
  described.options.warmup = o.map.warmup;
  described.options.k = o.k;
  described.options.local_map = o.local_map;
  described.options.hnsw_candidates = o.hnsw_candidates;
  if (!o.verify) o.verify = described.extractor.comparison.relative_yaw && !o.map.no_clouds;
  if (o.sure) described.options.target_precision = *o.sure;
  const NewMap new_map(o.map.file);
  auto map = o.map.open(described);  // before the work of calibrating
  std::optional<Calibration> learnt;
  if (!o.calibrate.empty()) {
    learnt = calibrated(o, described, sensor_of(source.some));
    need_target_precision(*learnt, o);
  }
  PlaceRecognizer recognizer(described.extractor, described.options, std::move(map), warn);
  if (learnt) recognizer.calibrate(*learnt);
  const std::string drive = o.map.drive_of(source.some);
  LoopDetectorOptions how = detector_options(o);
  how.drive = drive;
  LoopDetector detector(recognizer, how);
  if (detector.verifies() && !o.threshold && recognizer.is_calibrated() &&
      !recognizer.verified_calibration())
    warn(
        "the map's threshold or calibration is for loops without registration and is ignored; give "
        "--calibrate DRIVE again, or --no-verify");
  if (!detector.threshold()) {
    if (const auto calibration = detector.calibration()) need_target_precision(*calibration, o);
    if (options.given("target-precision"))
      throw UsageError("--target-precision: this feature is not calibrated; add --calibrate DRIVE");
    if (!o.all && !o.feature.quiet)
      note("no threshold: every scan is printed; --calibrate DRIVE estimates one");
  } else if (!o.threshold && !o.feature.quiet) {
    note(str("threshold: loops with a score of at least ", number(*detector.threshold(), 3),
             " are accepted"));
  }
  const bool all = o.all || !detector.threshold();

  std::ofstream file;
  if (!o.output.empty()) {
    file.open(o.output);
    if (!file) throw Error(o.output.string() + ": cannot be written");
  }
  LoopWriter writer(o.output.empty() ? std::cout : file, o.format);
  std::optional<PoseGraphWriter> graph;
  if (!o.g2o.empty()) graph.emplace(o.g2o);
  std::optional<TrajectoryWriter> trajectory;
  if (!o.tum.empty()) trajectory.emplace(o.tum);
  std::vector<double> milliseconds;
  LoopSummary summary(o.exclusion, detector.threshold());
  int64_t trajectory_poses = 0, poses = 0, not_in_graph = 0;
  cli::Progress progress("recognizing", "scans", !o.feature.no_progress && !o.feature.quiet);
  const auto total = static_cast<int64_t>(source.some.scans.size());
  recognize(source.stream, detector, !o.no_deskew, interrupted, [&](const Visit& visit) {
    const Detection& found = visit.found;
    summary.add(found);
    progress.update(summary.scans(), std::max(summary.scans(), total));
    if (!found.error.empty()) {
      warn_skipped(found.error);
      return;
    }
    milliseconds.push_back(visit.milliseconds);
    poses += visit.scan.pose ? 1 : 0;
    const bool registered = found.registered && found.registered->accepted;
    if (graph && registered && !found.index) ++not_in_graph;
    if (graph && found.index) {
      graph->vertex(*found.index, o.poses.as_given(visit.scan.pose));
      if (registered) {
        graph->known_vertex(found.loop->index, o.poses.as_given(found.loop->pose));
        graph->edge(found.loop->index, *found.index, found.registered->T_place_query,
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
      note(str("the map has another recording '", drive, "'; this one is stored as '",
               detector.drive(), "'"));
    std::cerr << summary.text() << ", " << recognizer.size() << " map entries\n";
    if (trajectory && trajectory_poses == 0)
      warn(o.tum.string() +
           ": the file is empty, because no loop was registered to a map entry with a pose");
    if (not_in_graph > 0)
      warn(str(o.g2o.string(), ": ", not_in_graph,
               " loops of scans that are not stored were skipped"));
    if (graph && poses == 0)
      warn(o.g2o.string() +
           ": the scans have no poses, so all vertices are at the origin, and there are no "
           "odometry edges");
    print_latencies(std::move(milliseconds), recognizer.size());
  }
  return summary.skipped() > 0 ? kScansSkipped : kOk;
}

}  // namespace

Command loops_command() {
  return {"loops", "detect loop closures in a drive, a folder of scans or a bag",
          "Detects loop closures online: describes every scan, compares it with the scans before "
          "it, prints a line for a loop, and adds the scan. DATA is a KITTI sequence or a folder "
          "of scans, or a bag or packets if the Python package is installed (`revisit-loops` then "
          "runs). - reads names of scan files from standard input, one per line.",
          "  revisit loops town > loops.csv\n"
          "  revisit loops town --map town.map --calibrate other_town --g2o town.g2o\n"
          "  revisit loops recording/ --follow 10 --map town.map --format jsonl\n"
          "  revisit loops drive.mcap --poses odometry_tum.txt --pose-frame lidar\n",
          with_options<LoopsOptions>(detect_loops)};
}

}  // namespace revisit::cli
