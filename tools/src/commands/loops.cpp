#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iostream>
#include <map>

#include "cli/command.h"
#include "cli/shell.h"
#include "cli/terminal.h"
#include "loops/labeled_matches.h"
#include "loops/loop_outputs.h"
#include "loops/loop_views.h"
#include "loops/loop_writer.h"
#include "loops/map_source.h"
#include "loops/recognize.h"
#include "loops/scan_stream.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

constexpr double kCalibrationRadius = 5;  // of a correct match [m]

struct LoopsOptions {
  FeatureOptions feature;
  MapArguments map;
  PoseOptions poses;
  fs::path output, g2o, tum;
  std::string format = "csv";
  Exclusion exclusion;
  std::optional<double> threshold;
  fs::path calibrate;
  std::optional<double> target_precision;
  std::optional<double> follow;
  std::optional<bool> verify;  // absent: if the feature and the map allow it
  bool all = false, no_deskew = false, no_verify = false, view = false, rerun = false;
  std::string command;
  std::string exclusion_text = to_string(exclusion), keyframes = "all", gate_text = "2,0.1,0.5";
  std::optional<OdometryGate> gate;

  void declare(Options& options);
  bool shows_progress() const { return !feature.quiet; }

 private:
  void declare_output(Options& options);
  void finish();
};

void LoopsOptions::declare(Options& options) {
  feature.default_candidates = kRingCandidates;
  feature.declare(options, Scans::kOneByOne);
  options.group("Loops:")
      .option("exclusion", "KIND=N",
              str("recent scans of this drive that are not compared: meters=30 (by poses, or else "
                  "by registration), frames=50, seconds=30 or none (default ",
                  exclusion_text, ")"),
              &exclusion_text)
      .common()
      .option("keyframes", "RULE",
              "stored scans: all, meters=1 (by poses) or similarity=0.9 (to the last one stored); "
              "all are queries (default all)",
              &keyframes)
      .option("threshold", "S",
              "minimum score of an accepted loop; if registered: 0.1 similarity + level - "
              "contradiction (default: from --target-precision)",
              &threshold)
      .excludes({"calibrate", "target-precision"})
      .common()
      .option("target-precision", "P",
              "fraction of accepted loops that are correct, 0 to 1, by the calibration of the map "
              "or the program (default 0.99, or 0.95 without registration)",
              &target_precision)
      .common()
      .option("calibrate", "DRIVE",
              "drive with poses whose matches refine the calibration, which the map keeps",
              &calibrate)
      .common()
      .flag("no-verify",
            "no registration of candidates (default for ring descriptors: GICP estimates the "
            "relative pose and its information, and free space decides)",
            &no_verify)
      .excludes({"g2o", "tum"})
      .common()
      .flag("all", "a line for every scan (default: only for accepted loops)", &all)
      .common()
      .option("follow", "SECONDS",
              "DATA is a folder that grows: end after this time without a new scan; with -: names "
              "of files that come one by one",
              &follow)
      .positive()
      .common();
  feature.declare_local_map(options);
  options.common();
  map.declare(options);
  poses.declare(options);
  options.option("odometry-gate", "BASE,RATE,HEIGHT",
                 "loops may differ from the poses by BASE + RATE * path horizontally, HEIGHT + "
                 "RATE / 20 * path vertically [m], and 2.5 + RATE / 20 * path in tilt [deg]; "
                 "none: poses reject no loops (default 2,0.1,0.5)",
                 &gate_text);
  declare_output(options);
  options.check([this] { finish(); });
}

void LoopsOptions::declare_output(Options& options) {
  options.flag(
      "no-deskew",
      "no motion compensation of scans (default: if scans have times, poses and times of points)",
      &no_deskew);
  options.group("Output:")
      .format({"csv", "jsonl"}, &format)
      .common()
      .option("output", "FILE", "file of the lines (default: standard output)", &output, 'o')
      .common()
      .option("g2o", "FILE", "pose graph of the poses and the registered loops", &g2o)
      .common()
      .option("tum", "FILE",
              "trajectory of the sensor from registered loops, in the frame of the map's poses",
              &tum)
      .common()
      .flag("view", "a page that grows, in a browser: loops.html, or as --output", &view)
      .common()
      .flag("rerun", "scans, path and loops live in Rerun, by the Python package", &rerun);
}

void LoopsOptions::finish() {
  if (output == "-") output.clear();
  exclusion = parse_exclusion(exclusion_text);
  check_keyframes(keyframes);
  gate = parse_odometry_gate(gate_text);
  if (target_precision && !(*target_precision > 0 && *target_precision < 1))
    throw UsageError("--target-precision: expected more than 0, less than 1, found ",
                     *target_precision);
  if (view && output.extension() == ".html")
    throw UsageError("--output ", output.string(),
                     ": it has the lines, beside which --view writes ",
                     "its page; expected another ending than .html");
  const bool needs_verify = !g2o.empty() || !tum.empty();
  if (needs_verify && map.no_clouds)
    throw UsageError("--no-clouds: not with ", !g2o.empty() ? "--g2o" : "--tum",
                     ", which needs registered loops; give one of the two");
  if (needs_verify || no_verify) verify = needs_verify;
}

LoopDetectorOptions detector_options(const LoopsOptions& o, const std::string& drive,
                                     const std::optional<OdometryGate>& gate) {
  return {.drive = drive,
          .exclusion = o.exclusion,
          .keyframes = o.keyframes,
          .verify = o.verify,
          .threshold = o.threshold,
          .target_precision = o.target_precision,
          .keep_clouds = !o.map.no_clouds && (*o.verify || !o.map.file.empty()),
          .odometry_gate = gate,
          .warn = warn};
}

/// Refines the calibration of the feature, not the map's, on a drive with poses. If the feature has
/// none, uses that drive alone.
Calibration calibrated(const LoopsOptions& o, const MapSource& source, const std::string& sensor) {
  const Dataset dataset = open_drive(o.feature, o.calibrate, sensor, true);
  Map map(source.extractor, source.options);
  LoopDetector detector(map, detector_options(o, "", std::nullopt));
  cli::Progress progress("calibrating", "scans", o.shows_progress());
  const MatchRule rule = rule_of(kCalibrationRadius, dataset);
  const std::vector<LabeledScore> matches = scores_by_place(
      labeled_loops(dataset, detector, rule, !o.no_deskew, progress.callback()), rule);
  if (std::ranges::none_of(matches, &LabeledScore::correct))
    throw InputError(
        o.calibrate.string() +
        ": no match is correct, so nothing can be calibrated; give a drive with revisits");
  const std::optional<Calibration> before = detector.calibration();
  Calibration calibration = before ? refined(*before, matches) : isotonic_calibration(matches);
  calibration.k = source.options.k;
  calibration.score = detector.score();
  calibration.radius = rule.radius;
  calibration.negative_radius = rule.negative_radius;
  calibration.trained_on = (before ? before->trained_on + ", and " : "") + dataset.name;
  return calibration;
}

void need_target_precision(const Calibration& calibration, const LoopsOptions& o) {
  const double precision = o.target_precision.value_or(default_target_precision(calibration.score));
  if (!calibration.threshold_for(precision))
    throw UsageError("--target-precision ", precision, o.target_precision ? "" : " (the default)",
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

/// "" if scans are deskewed.
std::string why_not_deskewed(const Dataset& data, bool no_deskew) {
  const auto none_has = [&](auto member) {
    return std::ranges::none_of(data.scans,
                                [&](const ScanRef& scan) { return (scan.*member).has_value(); });
  };
  if (no_deskew) return ": --no-deskew";
  if (none_has(&ScanRef::pose)) return ": no poses";
  return none_has(&ScanRef::time) ? ": no times of scans" : "";
}

void note_point_times(const Dataset& data, bool no_deskew) {
  const bool none = data.point_times.starts_with("none");
  const std::string why_not = none ? "" : why_not_deskewed(data, no_deskew);
  note(str("point times: ", data.point_times, "; scans are ",
           none || !why_not.empty() ? "not deskewed" + why_not : "deskewed by their poses"));
}

/// Where lines, the pose graph and the trajectory go.
class LoopOutputs {
 public:
  LoopOutputs(const LoopsOptions& options, std::optional<double> threshold,
              const std::string& drive)
      : o_(options), threshold_(threshold) {
    if (!page().empty()) page_.emplace(page(), drive, o_.command);
    if (o_.rerun) viewer_.emplace(o_.feature);
    if (!o_.g2o.empty()) graph_.emplace(o_.g2o);
    if (!o_.tum.empty()) trajectory_.emplace(o_.tum);
    writer_.emplace(open_file(), o_.format);  // last, because it replaces a file at once
  }

  void add(const Visit& visit, const std::string& drive) {
    const Detection& found = visit.found;
    poses_ += visit.scan.pose ? 1 : 0;
    const bool registered = found.accepted && found.registered;
    if (graph_) add_to_graph(visit, drive, registered);
    if (trajectory_ && registered && found.loop->pose) {
      trajectory_->add(visit.scan.time.value_or(static_cast<double>(visit.scan.frame)),
                       *found.loop->pose * found.registered->T_place_query);
      ++trajectory_poses_;
    }
    const bool is_written = found.accepted || !found.questioned.empty() || o_.all || !threshold_;
    if (!is_written && !page_ && !viewer_) return;
    reports::LoopLine line = line_of(visit, drive);
    if (threshold_) line.set_threshold(*threshold_);
    if (is_written) writer_->write(line);
    if (page_) page_->add(line);
    if (viewer_) viewer_->add(line);
  }
  void finish() {
    finish_page();
    if (viewer_) viewer_->finish();
  }
  void finish_page() {
    if (page_) page_->finish();
  }

  /// "": none.
  std::string page() const {
    if (!o_.view) return "";
    return fs::path(o_.output.empty() ? "loops" : o_.output).replace_extension("html").string();
  }

  /// `questioned`: frames.
  void warn_of_gaps(const std::vector<int64_t>& questioned) const {
    std::vector<std::string> edges;
    for (const int64_t frame : questioned)
      if (const auto edge = edges_.find(frame); edge != edges_.end()) edges.push_back(edge->second);
    if (!edges.empty())
      warn(str(o_.g2o.string(), ": later loops contradict the edges ", joined(edges, ", "),
               "; remove them"));
    if (trajectory_ && trajectory_poses_ == 0)
      warn(o_.tum.string() +
           ": the file is empty, because no loop was registered to a map entry with a pose");
    if (not_in_graph_ > 0)
      warn(str(o_.g2o.string(), ": ", not_in_graph_,
               " loops of scans that are not stored were skipped"));
    if (graph_ && poses_ == 0)
      warn(o_.g2o.string() +
           ": the scans have no poses, so all vertices are at the origin, and there are no "
           "odometry edges");
  }

 private:
  std::ostream& open_file() {
    if (o_.output.empty()) return std::cout;
    file_.open(o_.output);
    if (!file_) throw Error(o_.output.string(), ": cannot be written: ", std::strerror(errno));
    return file_;
  }

  void add_to_graph(const Visit& visit, const std::string& drive, bool registered) {
    const Detection& found = visit.found;
    if (registered && !found.index) ++not_in_graph_;
    if (!found.index) return;
    graph_->vertex(*found.index, visit.scan.pose,
                   scan_name(drive, visit.scan.frame, visit.scan.time));
    if (!registered) return;
    const Loop& loop = *found.loop;
    graph_->known_vertex(loop.index, loop.pose, scan_name(loop.drive, loop.frame, loop.time));
    graph_->edge(found.loop->index, *found.index, found.registered->T_place_query,
                 found.registered->information);
    edges_[visit.scan.frame] = str(found.loop->index, "-", *found.index);
  }

  const LoopsOptions& o_;
  const std::optional<double> threshold_;
  std::ofstream file_;
  std::optional<LoopWriter> writer_;
  std::optional<PoseGraphWriter> graph_;
  std::optional<TrajectoryWriter> trajectory_;
  std::optional<LoopPage> page_;
  std::optional<RerunViewer> viewer_;
  std::map<int64_t, std::string> edges_;  // of loops, by the frames of their queries
  int64_t trajectory_poses_ = 0, poses_ = 0, not_in_graph_ = 0;
};

/// A run of the command: its source of scans, the map, the detector, and what came out.
class LoopRun {
 public:
  LoopRun(LoopsOptions& options, bool precision_given)
      : o_(options),
        source_(open_source(o_.feature, o_.poses, o_.follow)),
        described_(describe_source()),
        new_map_(o_.map.file),
        map_(described_.extractor, described_.options, open_map(), warn),
        drive_(o_.map.drive_of(source_.some)),
        detector_(map_, detector_options(o_, drive_, o_.gate)) {
    if (calibration_) detector_.calibrate(*calibration_);
    check_threshold(precision_given);
    if (!o_.feature.quiet && !source_.some.point_times.empty())
      note_point_times(source_.some, o_.no_deskew);
  }

  int run() {
    LoopOutputs outputs(o_, detector_.threshold(), drive_);
    LoopSummary summary(o_.exclusion, detector_.threshold());
    std::vector<double> milliseconds;
    try {
      cli::Progress progress("recognizing", "scans", o_.shows_progress());
      recognize(source_.next, detector_, !o_.no_deskew, [&](const Visit& visit) {
        summary.add(visit.found);
        progress.update(summary.scans(), std::max(summary.scans(), source_.count));
        if (!visit.found.error.empty()) {
          warn_skipped(visit.found.error);
          return;
        }
        milliseconds.push_back(visit.milliseconds);
        outputs.add(visit, detector_.drive());
      });
    } catch (const Error&) {
      outputs.finish_page();
      throw;
    }
    outputs.finish();
    if (!o_.feature.quiet) {
      if (detector_.drive() != drive_)
        note(str("the map has another recording '", drive_, "'; this one is stored as '",
                 detector_.drive(), "'"));
      std::cerr << summary.text() << ", " << map_.size() << " map entries\n";
      if (!outputs.page().empty()) std::cerr << "page: " << outputs.page() << "\n";
      outputs.warn_of_gaps(summary.questioned());
      print_latencies(std::move(milliseconds), map_.size());
    }
    return summary.skipped() > 0 ? kScansSkipped : kOk;
  }

 private:
  MapSource describe_source() {
    MapSource described = map_source(o_.feature, source_.some, feature_key_of(o_.map.file));
    described.options.warmup = o_.map.warmup;
    described.options.hnsw_candidates = o_.feature.graph_candidates();
    if (!o_.verify) o_.verify = described.extractor.comparison.relative_yaw && !o_.map.no_clouds;
    return described;
  }

  std::unique_ptr<MapStore> open_map() {
    auto map = o_.map.open(described_);  // before the work of calibrating
    if (!o_.calibrate.empty()) {
      calibration_ = calibrated(o_, described_, sensor_of(source_.some));
      need_target_precision(*calibration_, o_);
    }
    return map;
  }

  void check_threshold(bool precision_given) const {
    if (detector_.threshold()) {
      if (!o_.threshold && !o_.feature.quiet)
        note(str("threshold: loops with a score of at least ", number(*detector_.threshold(), 3),
                 " are accepted"));
      return;
    }
    if (const auto calibration = detector_.calibration()) need_target_precision(*calibration, o_);
    if (precision_given)
      throw UsageError("--target-precision: this feature is not calibrated; add --calibrate DRIVE");
    if (!o_.all && !o_.feature.quiet)
      note("no threshold: every scan is printed; --calibrate DRIVE estimates one");
  }

  LoopsOptions& o_;
  const ScanSource source_;
  std::optional<Calibration> calibration_;  // by --calibrate
  MapSource described_;
  const NewMap new_map_;
  Map map_;
  const std::string drive_;
  LoopDetector detector_;
};

int detect_loops(LoopsOptions& o, const Options& options) {
  o.command = shell_command("revisit loops", options.arguments());
  return LoopRun(o, options.given("target-precision")).run();
}

}  // namespace

Command loops_command() {
  return {
      "loops", "detect loop closures in a drive, a folder of scans or a bag",
      "Detects loop closures in a sequence of LiDAR scans and estimates the relative pose of each. "
      "DATA is a KITTI sequence or a folder of scans, "
      "or, read by the Python package, a bag, packets or another data set. - reads names of scan "
      "files from standard input, one per line, or scans of `revisit.recordings`.",
      "  revisit loops town > loops.csv\n"
      "  revisit loops town --map town.map --calibrate other_town --g2o town.g2o\n"
      "  revisit loops recording/ --follow 10 --map town.map --format jsonl\n"
      "  revisit loops drive.mcap --poses odometry_tum.txt --pose-frame lidar\n",
      with_options<LoopsOptions>(detect_loops)};
}

}  // namespace revisit::cli
