#include <iostream>

#include "cli/command.h"
#include "cli/shell.h"
#include "cli/terminal.h"
#include "revisit/simulation/simulation.h"

namespace revisit::cli {
namespace {

constexpr const char* kSimulateSummary =
    "Writes a data set in KITTI odometry layout: a drive through a synthetic town or another "
    "environment. The route is generated, or given by a KITTI poses file; the environment is built "
    "along it. Equal settings give equal bytes for any number of threads. If interrupted, run the "
    "same command again to resume.";

constexpr const char* kSimulateExamples =
    "  revisit-simulate -o town\n"
    "  revisit-simulate -o town --sequence 01 --route opposite --seed 7\n"
    "  revisit-simulate -o look --sensor vlp16 --frames 0-99\n"
    "  revisit-simulate -o seen --camera --image-scale 0.5\n"
    "  revisit-simulate -o road --surroundings country --sensor-height 2.1 --sensor-pitch 2\n"
    "  revisit-simulate -o sim --sequence 05 --poses poses/05.txt --every 2\n"
    "  revisit-simulate -o places/rotation --preset hkust-rotation\n\n"
    "Only x, z and heading of given poses are used. The sensor stays at its height above a\n"
    "smooth ground, because the height in ground-truth files drifts by meters between visits of\n"
    "one place. The poses file is copied unchanged: line i is frame i, counted from 0, and scan\n"
    "000042.bin is frame 42. With --every or --frames some lines have no scan.\n";

void parse_frames(const std::string& text, SimulationConfig* config) {
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

void print_scans(const SimulationSummary& summary) {
  std::cout << summary.scans << " scans of " << number(summary.mean_points, 0)
            << " points on average";
  if (summary.kept > 0) std::cout << " (" << summary.kept << " kept from an earlier run)";
}

void print_speed(const SimulationSummary& summary) {
  const int64_t made = summary.scans - summary.kept;
  if (made == 0) return;
  std::cout << number(static_cast<double>(made) / summary.scan_seconds, 1) << " scans/s; town of "
            << number(static_cast<double>(summary.triangles) * 1e-6, 2)
            << " million triangles built in " << number(summary.build_seconds, 1) << " s\n";
}

Arguments next_arguments(const SimulationConfig& config) {
  return {config.output.string(), "--sequence", config.sequence};
}

void print(const SimulationConfig& config, const SimulationSummary& summary) {
  print_scans(summary);
  if (config.camera) std::cout << ", each with an image";
  std::cout << ", of a drive of " << number(summary.path_meters, 0) << " m\n";
  print_speed(summary);
  std::cout << "in " << (config.output / "sequences" / config.sequence).string() << ", poses in "
            << (config.output / "poses" / (config.sequence + ".txt")).string() << "\n"
            << "next: " << shell_command("revisit eval", next_arguments(config)) << "\n";
}

struct SimulateOptions {
  SimulationConfig drive;
  std::string preset;
  std::optional<std::string> frames;
  bool quiet = false;

  void declare(Options& options);
};

void SimulateOptions::declare(Options& options) {
  options.option("output", "DIR", "root of the data set", &drive.output, 'o')
      .required()
      .choice("preset", {"hkust-rotation", "hkust-objects"},
              "places instead of a drive, a folder each: hkust-rotation (7 places, 77 scans of a "
              "VLP-16 rotated by about 40 degrees between scans) or hkust-objects (the same "
              "places, 94 scans with people and cars passing)",
              &preset)
      .excludes({"sequence", "route", "length", "poses", "calib", "surroundings", "traffic",
                 "frames", "every", "sensor", "sensor-height", "sensor-pitch", "sensor-roll",
                 "rolling-shutter", "camera", "image-scale", "light"})
      .option("sequence", "NAME", "name of the sequence (default 00)", &drive.sequence)
      .flag("overwrite", "replacement of scans made with other settings", &drive.overwrite)
      .group("Route:")
      .choice("route", {"loop", "opposite", "both"},
              "direction of revisits: loop (the same), opposite, or both (default loop)",
              &drive.route)
      .option("length", "METERS", "length of the generated route, 300 to 30000 (default 1200)",
              &drive.length)
      .option("poses", "FILE", "KITTI poses of the route (default: a generated route)",
              &drive.poses)
      .excludes({"route", "length"})
      .option("calib", "FILE", "calib.txt of --poses (default: a typical one)", &drive.calibration)
      .choice("surroundings",
              {"town", "suburb", "village", "country", "motorway", "car-park", "old-town", "rows",
               "office", "office-irregular", "office-changed", "office-carried", "floors",
               "stairwell", "garage", "mine", "greenhouse", "forest", "container-yard"},
              "environment: town, suburb, village, country, motorway, car-park, old-town or rows; "
              "off the street, with a robot's own drive: office, office-irregular, "
              "office-changed, office-carried, floors, stairwell, garage, mine, greenhouse, forest "
              "or container-yard (default town)",
              &drive.surroundings)
      .option("traffic", "FACTOR",
              "factor of the usual number of moving vehicles, 0 to 10 (default 1)", &drive.traffic)
      .group("Frames (10 per second, 0.8 m apart on a generated route, 0.1 m for a robot):")
      .option("frames", "N|A-B", "first N frames, or frames A to B inclusive (default: all)",
              &frames)
      .option("every", "N", "frame stride (default 1)", &drive.every)
      .group("Sensor:")
      .choice("sensor",
              {"hdl64", "hdl32", "vlp16", "pandar-xt32", "ouster-os0-32", "ouster-os1-64",
               "livox-mid360", "front120", "livox-avia"},
              "sensor: hdl64, hdl32, vlp16, pandar-xt32, ouster-os0-32, ouster-os1-64, "
              "livox-mid360, front120 "
              "or livox-avia (default hdl64)",
              &drive.sensor)
      .option("sensor-height", "METERS", "height above the ground (default 1.73, or a robot's)",
              &drive.sensor_height)
      .option("sensor-pitch", "DEG", "pitch of the mount; positive: forward down (default 0)",
              &drive.sensor_pitch)
      .option("sensor-roll", "DEG", "roll of the mount; positive: right down (default 0)",
              &drive.sensor_roll)
      .flag(
          "rolling-shutter",
          "motion during a scan (0.1 s); scans are .pcd files with the field time (default: none)",
          &drive.rolling_shutter)
      .option("noise", "METERS", "standard deviation of a range (default 0.02)", &drive.range_noise)
      .option("dropout", "FRACTION", "fraction of returns lost at random (default 0.01)",
              &drive.dropout)
      .group("Camera:")
      .flag("camera", "gray images of a camera beside the sensor: image_0/000000.png",
            &drive.camera)
      .option("image-scale", "S", "scale of the images, 0.1 to 1 (1241 x 376) (default 1)",
              &drive.image_scale)
      .needs("camera")
      .choice<bool>("light", {{"changing", true}, {"steady", false}},
                    "light: changing (sun, clouds and exposure differ between visits) or steady "
                    "(default changing)",
                    &drive.changing_light)
      .needs("camera")
      .group("General:")
      .option("seed", "N", "seed of the environment (default 1)", &drive.seed)
      .option("threads", "N", "threads (default: all cores)", &drive.threads)
      .flag("quiet", "no progress line and no summary", &quiet, 'q');
  options.check([this] {
    if (frames) parse_frames(*frames, &drive);
  });
}

int simulate_places(const SimulateOptions& o) {
  const SimulationSummary summary = [&] {
    Progress progress("simulating", "scans", !o.quiet);
    return simulate_places(o.drive, o.preset == "hkust-objects", progress.callback(), interrupted);
  }();
  if (o.quiet) return kOk;
  print_scans(summary);
  std::cout << ", of 7 places\n";
  print_speed(summary);
  std::cout << "in " << o.drive.output.string() << ", a folder per place; poses in "
            << (o.drive.output / "scans.csv").string() << "\n";
  return kOk;
}

int run_simulate(const SimulateOptions& o) {
  if (!o.preset.empty()) return simulate_places(o);
  const SimulationSummary summary = [&] {
    Progress progress("simulating", "scans", !o.quiet);
    return simulate(o.drive, progress.callback(), interrupted);
  }();
  if (!o.quiet) print(o.drive, summary);
  return kOk;
}

int run_simulator(const Arguments& arguments) {
  const Command command = {
      "revisit-simulate", "simulate a drive in KITTI's layout",        kSimulateSummary,
      kSimulateExamples,  with_options<SimulateOptions>(run_simulate), {}};
  return run(command, command.name, arguments);
}

}  // namespace
}  // namespace revisit::cli

int main(int argc, char** argv) {
  return revisit::cli::run_main("revisit-simulate", argc, argv, revisit::cli::run_simulator);
}
