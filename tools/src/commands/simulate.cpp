#include <iostream>

#include "cli/command.h"
#include "cli/interrupt.h"
#include "cli/parser.h"
#include "cli/progress.h"
#include "cli/shell.h"
#include "cli/table.h"
#include "models/find_model.h"
#include "revisit/pipeline/simulation.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

// argp fills paragraphs: no line breaks inside them.
constexpr const char* kSummary =
    "Writes a data set in KITTI odometry layout: a drive through a synthetic town. The route is "
    "generated, or given by a KITTI poses file; then the town is laid out along it. Equal settings "
    "give equal bytes for any number of threads. An interrupted run continues when it is started "
    "again.";

constexpr const char* kExamples =
    "  revisit simulate -o town\n"
    "  revisit simulate -o town --sequence 01 --route opposite --seed 7\n"
    "  revisit simulate -o look --sensor vlp16 --frames 0-99\n"
    "  revisit simulate -o seen --camera --image-scale 0.5\n"
    "  revisit simulate -o sim --sequence 05 --poses poses/05.txt --every 2\n"
    "  revisit simulate -o places/rotation --preset hkust-rotation\n\n"
    "Given poses are used as seen from above (x, z, heading). The sensor always stands 1.73 m "
    "above "
    "a smooth ground, because the height in ground-truth files drifts by metres between visits of "
    "one place. The poses file is copied as it is, with all its lines: line i is frame i, counted "
    "from 0, and scan 000042.bin is frame 42. With --every or --frames there are lines without a "
    "scan.\n";

/// "N": the first N frames. "A-B": frames A to B, inclusive.
void parse_frames(const std::string& text, pipeline::SimulationConfig* config) {
  const size_t dash = text.find('-');
  if (dash == std::string::npos) {
    const int count = parse_value<int>("--frames", text);
    if (count < 1) throw UsageError("--frames: expected at least 1, found " + text);
    config->last_frame = count - 1;
    return;
  }
  config->first_frame = parse_value<int>("--frames", text.substr(0, dash));
  config->last_frame = parse_value<int>("--frames", text.substr(dash + 1));
}

void print_scans(const pipeline::SimulationSummary& summary) {
  std::cout << summary.scans << " scans of " << number(summary.mean_points, 0)
            << " points on average";
  if (summary.kept > 0) std::cout << " (" << summary.kept << " kept from an earlier run)";
}

void print_speed(const pipeline::SimulationSummary& summary) {
  const int64_t made = summary.scans - summary.kept;
  if (made == 0) return;
  std::cout << number(static_cast<double>(made) / summary.scan_seconds, 1) << " scans/s; town of "
            << number(static_cast<double>(summary.triangles) * 1e-6, 2)
            << " million triangles built in " << number(summary.build_seconds, 1) << " s\n";
}

/// Of an evaluation that works as it stands, with a network when there is one.
Arguments next_arguments(const pipeline::SimulationConfig& config) {
  Arguments arguments = {config.output.string(), "--sequence", config.sequence};
  if (config.sensor == pipeline::LidarModel::kVlp16)
    arguments.insert(arguments.end(), {"--sensor", "vlp16"});
  try {
    models::find_model({});
  } catch (const Error&) {
    arguments.insert(arguments.end(), {"--feature", "data"});
  }
  return arguments;
}

void print(const pipeline::SimulationConfig& config, const pipeline::SimulationSummary& summary) {
  print_scans(summary);
  if (config.camera) std::cout << ", each with a picture";
  std::cout << ", of a drive of " << number(summary.path_metres, 0) << " m\n";
  print_speed(summary);
  std::cout << "in " << (config.output / "sequences" / config.sequence).string() << ", poses in "
            << (config.output / "poses" / (config.sequence + ".txt")).string() << "\n"
            << "next: " << shell_command("revisit eval", next_arguments(config)) << "\n";
}

struct SimulateOptions {
  std::optional<fs::path> output, poses, calib;
  std::optional<std::string> sequence, frames;
  std::optional<pipeline::PlaceScans> preset;
  std::optional<pipeline::RouteKind> route;
  std::optional<pipeline::LidarModel> sensor;
  std::optional<bool> light;  // changing
  std::optional<double> length, image_scale;
  std::optional<int> every;
  double noise = 0.02, dropout = 0.01;
  int64_t seed = 1;
  int threads = 0;
  bool camera = false, overwrite = false, no_progress = false, quiet = false;
};

SimulateOptions parse_options(const Arguments& arguments) {
  using pipeline::LidarModel;
  using pipeline::PlaceScans;
  using pipeline::RouteKind;
  SimulateOptions o;
  Parser parser("revisit simulate", "-o DIR", kSummary, kExamples);
  parser.option("output", "DIR", "root of the data set", &o.output, 'o')
      .choice<PlaceScans>(
          "preset",
          {{"hkust-rotation", PlaceScans::kRotation}, {"hkust-objects", PlaceScans::kObjects}},
          "instead of a drive: hkust-rotation (7 places, 77 scans of a VLP-16 turned by about "
          "40 degrees each) or hkust-objects (the same places, 94 scans with people and cars "
          "passing); a folder per place",
          &o.preset)
      .option("sequence", "NN", "name of the sequence (default 00)", &o.sequence)
      .flag("overwrite", "replace scans made with other settings", &o.overwrite)
      .group("Where to drive:")
      .choice<RouteKind>(
          "route",
          {{"loop", RouteKind::kLoop},
           {"opposite", RouteKind::kOpposite},
           {"both", RouteKind::kBoth}},
          "generated: loop (revisits in the same direction, the default), opposite, or both",
          &o.route)
      .option("length", "M", "of the generated route, in metres (default 1200)", &o.length)
      .option("poses", "FILE", "drive along these KITTI poses instead", &o.poses)
      .option("calib", "FILE", "calib.txt of these poses (default: a typical one)", &o.calib)
      .group("Which frames (10 a second, 0.8 m apart on a generated route):")
      .option("frames", "N|A-B", "the first N, or A to B inclusive (default: all)", &o.frames)
      .option("every", "N", "every Nth frame only", &o.every)
      .group("Sensor:")
      .choice<LidarModel>("sensor", {{"hdl64", LidarModel::kHdl64}, {"vlp16", LidarModel::kVlp16}},
                          "(default: hdl64)", &o.sensor)
      .option("noise", "M", "standard deviation of a range in metres (default 0.02)", &o.noise)
      .option("dropout", "SHARE", "of returns lost at random (default 0.01)", &o.dropout)
      .group("Camera:")
      .flag("camera", "also what a camera beside it sees: image_0/000000.png, gray", &o.camera)
      .option("image-scale", "S", "size of the pictures, 1 is 1241 x 376 (default), down to 0.1",
              &o.image_scale)
      .choice<bool>(
          "light", {{"changing", true}, {"steady", false}},
          "changing: the sun wanders, clouds pass and the exposure errs, so passes of one "
          "place differ (default); or steady",
          &o.light)
      .group("General:")
      .option("seed", "S", "another seed is another town (default 1)", &o.seed)
      .option("threads", "T", "default: all", &o.threads)
      .flag("no-progress", "no progress line", &o.no_progress)
      .flag("quiet", "no progress line and no summary", &o.quiet, 'q');
  parser.parse(arguments);
  if (!o.output) throw UsageError("--output DIR is missing: where shall the data set go?");
  if (o.seed < 0) throw UsageError(str("--seed: expected 0 or more, found ", o.seed));
  return o;
}

int simulate_places(const SimulateOptions& o) {
  pipeline::PlaceSimulationConfig config;
  config.scans = *o.preset;
  const std::pair<const char*, bool> drive_only[] = {{"sequence", o.sequence.has_value()},
                                                     {"route", o.route.has_value()},
                                                     {"length", o.length.has_value()},
                                                     {"poses", o.poses.has_value()},
                                                     {"calib", o.calib.has_value()},
                                                     {"frames", o.frames.has_value()},
                                                     {"every", o.every.has_value()},
                                                     {"sensor", o.sensor.has_value()},
                                                     {"camera", o.camera},
                                                     {"image-scale", o.image_scale.has_value()},
                                                     {"light", o.light.has_value()}};
  for (const auto& [name, given] : drive_only)
    if (given) throw UsageError(str("--", name, " is about drives: leave it out with --preset"));
  config.output = *o.output;
  config.range_noise = o.noise, config.dropout = o.dropout;
  config.seed = static_cast<uint64_t>(o.seed);
  config.threads = o.threads, config.overwrite = o.overwrite;
  pipeline::SimulationSummary summary;
  {
    Progress progress("simulating", "scans", !o.no_progress && !o.quiet);
    summary = pipeline::simulate_places(config, progress.callback(), interrupted);
  }
  if (o.quiet) return kOk;
  print_scans(summary);
  std::cout << ", of 7 places\n";
  print_speed(summary);
  std::cout << "in " << config.output.string() << ", a folder per place; where each was taken in "
            << (config.output / "scans.csv").string() << "\n";
  return kOk;
}

}  // namespace

int simulate_command(const Arguments& arguments) {
  const SimulateOptions o = parse_options(arguments);
  if (o.preset) return simulate_places(o);
  if (o.poses && (o.route || o.length))
    throw UsageError("--poses gives the route: leave out --route and --length");
  if (!o.camera && (o.image_scale || o.light))
    throw UsageError("--image-scale and --light are about pictures: add --camera");

  pipeline::SimulationConfig config;
  config.output = *o.output;
  config.sequence = o.sequence.value_or(config.sequence);
  config.poses = o.poses, config.calibration = o.calib;
  config.length = o.length.value_or(config.length);
  config.route = o.route.value_or(pipeline::RouteKind::kLoop);
  config.sensor = o.sensor.value_or(pipeline::LidarModel::kHdl64);
  if (o.frames) parse_frames(*o.frames, &config);
  config.every = o.every.value_or(config.every);
  if (o.camera) config.camera = {o.image_scale.value_or(1), o.light.value_or(true)};
  config.range_noise = o.noise, config.dropout = o.dropout;
  config.seed = static_cast<uint64_t>(o.seed);
  config.threads = o.threads, config.overwrite = o.overwrite;

  pipeline::SimulationSummary summary;
  {
    Progress progress("simulating", "scans", !o.no_progress && !o.quiet);
    summary = pipeline::simulate(config, progress.callback(), interrupted);
  }
  if (!o.quiet) print(config, summary);
  return kOk;
}

}  // namespace revisit::cli
