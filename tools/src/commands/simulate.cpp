#include <charconv>
#include <cstdio>
#include <iostream>

#include "cli/command.h"
#include "cli/interrupt.h"
#include "cli/parser.h"
#include "cli/progress.h"
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
    "  revisit simulate -o sim --sequence 05 --poses poses/05.txt --every 2\n\n"
    "Given poses are used as seen from above (x, z, heading). The sensor always stands 1.73 m "
    "above "
    "a smooth ground, because the height in ground-truth files drifts by metres between visits of "
    "one place. The poses file is copied as it is, with all its lines: line i is frame i, counted "
    "from 0, and scan 000042.bin is frame 42. With --every or --frames there are lines without a "
    "scan.\n";

template <class Value>
Value choose(const std::string& option, const std::string& name,
             const std::vector<std::pair<std::string, Value>>& choices) {
  std::vector<std::string> names;
  std::string list;
  for (const auto& [known, value] : choices) {
    if (known == name) return value;
    names.push_back(known);
    list += (list.empty() ? "" : ", ") + known;
  }
  throw UsageError(
      str(option, ": expected one of ", list, "; found '", name, "'", did_you_mean(name, names)));
}

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

std::string fixed(double value, int digits) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

void print(const pipeline::SimulationConfig& config, const pipeline::SimulationSummary& summary) {
  const int64_t made = summary.scans - summary.kept;
  std::cout << summary.scans << " scans of " << fixed(summary.mean_points, 0)
            << " points on average";
  if (summary.kept > 0) std::cout << " (" << summary.kept << " kept from an earlier run)";
  std::cout << ", of a drive of " << fixed(summary.path_metres, 0) << " m\n";
  if (made > 0)
    std::cout << fixed(static_cast<double>(made) / summary.scan_seconds, 1) << " scans/s; town of "
              << fixed(static_cast<double>(summary.triangles) * 1e-6, 2)
              << " million triangles built in " << fixed(summary.build_seconds, 1) << " s\n";
  std::cout << "in " << (config.output / "sequences" / config.sequence).string() << ", poses in "
            << (config.output / "poses" / (config.sequence + ".txt")).string() << "\n"
            << "next: revisit eval " << config.output.string() << " --sequence " << config.sequence
            << " --model PROTOTXT --weights CAFFEMODEL\n";
}

}  // namespace

int simulate_command(const Arguments& arguments) {
  using pipeline::LidarModel;
  using pipeline::RouteKind;
  pipeline::SimulationConfig config;
  std::optional<fs::path> output;
  std::optional<std::string> route, frames;
  std::optional<double> length;
  std::string sensor = "hdl64";
  int64_t seed = 1;
  bool no_progress = false, quiet = false;

  Parser parser("revisit simulate", "-o DIR", kSummary, kExamples);
  parser.option("output", "DIR", "root of the data set, in KITTI odometry layout", &output, 'o')
      .option("sequence", "NN", "name of the sequence (default 00)", &config.sequence)
      .flag("overwrite", "replace scans made with other settings", &config.overwrite)
      .group("Where to drive:")
      .option("route", "KIND",
              "generated: loop (revisits in the same direction, the default), opposite, or both",
              &route)
      .option("length", "M", "of the generated route, in metres (default 1200)", &length)
      .option("poses", "FILE", "drive along these KITTI poses instead", &config.poses)
      .option("calib", "FILE", "calib.txt of these poses (default: a typical one)",
              &config.calibration)
      .group("Which frames (10 a second, 0.8 m apart on a generated route):")
      .option("frames", "N|A-B", "the first N, or A to B inclusive (default: all)", &frames)
      .option("every", "N", "every Nth frame only", &config.every)
      .group("Sensor:")
      .option("sensor", "NAME", "hdl64 (default) or vlp16", &sensor)
      .option("noise", "M", "standard deviation of a range in metres (default 0.02)",
              &config.range_noise)
      .option("dropout", "SHARE", "of returns lost at random (default 0.01)", &config.dropout)
      .group("General:")
      .option("seed", "S", "another seed is another town (default 1)", &seed)
      .option("threads", "T", "default: all", &config.threads)
      .flag("no-progress", "no progress line", &no_progress)
      .flag("quiet", "no progress line and no summary", &quiet, 'q');
  parser.parse(arguments);

  if (!output) throw UsageError("--output DIR is missing: where shall the data set go?");
  if (config.poses && (route || length))
    throw UsageError("--poses gives the route: leave out --route and --length");
  if (seed < 0) throw UsageError(str("--seed: expected 0 or more, found ", seed));
  config.output = *output;
  config.seed = static_cast<uint64_t>(seed);
  config.length = length.value_or(config.length);
  config.route = choose<RouteKind>(
      "--route", route.value_or("loop"),
      {{"loop", RouteKind::kLoop}, {"opposite", RouteKind::kOpposite}, {"both", RouteKind::kBoth}});
  config.sensor = choose<LidarModel>(
      "--sensor", sensor, {{"hdl64", LidarModel::kHdl64}, {"vlp16", LidarModel::kVlp16}});
  if (frames) parse_frames(*frames, &config);

  pipeline::SimulationSummary summary;
  {
    Progress progress("simulating", "scans", !no_progress && !quiet);
    summary = pipeline::simulate(config, progress.callback(), interrupted);
  }
  if (!quiet) print(config, summary);
  return kOk;
}

}  // namespace revisit::cli
