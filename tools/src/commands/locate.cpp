#include <iostream>

#include "cli/built_in.h"
#include "cli/command.h"
#include "cli/terminal.h"
#include "loops/loop_writer.h"
#include "loops/map_source.h"
#include "loops/recording.h"
#include "loops/scan_stream.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/maps/map_store.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

struct LocateOptions {
  FeatureOptions feature;
  fs::path map;
  std::vector<fs::path> scans;
  std::optional<double> threshold, target_precision;
  bool no_verify = false;
  std::string format = "csv";

  void declare(Options& options) {
    feature.default_candidates = kRingCandidates;
    options.argument("MAP", &map).argument("SCAN", &scans);
    feature.declare_data(options);
    feature.declare_describing(options, Scans::kOneByOne);
    options.group("Places:")
        .option("threshold", "S",
                "minimum score of an accepted place (default: from --target-precision)", &threshold)
        .excludes({"target-precision"})
        .common()
        .option(
            "target-precision", "P",
            "fraction of accepted places that are correct, 0 to 1, by the calibration of the map "
            "or the program (default 0.99, or 0.95 without registration)",
            &target_precision)
        .common()
        .flag("no-verify", "similarities alone, e.g. if the map has no points; no pose", &no_verify)
        .common()
        .format({"csv", "jsonl"}, &format)
        .common()
        .check([this] { need_built_in_for_map("revisit locate", map); });
  }
};

/// Scans of all arguments, one after the other. Frames of single files count them.
ScanStream scans_of(const LocateOptions& o) {
  return [&o, at = size_t{0}, stream = ScanStream()]() mutable -> std::optional<ScanRef> {
    while (true) {
      if (stream)
        if (std::optional<ScanRef> scan = stream()) return scan;
      stream = nullptr;
      if (at == o.scans.size()) return std::nullopt;
      const fs::path& scan = o.scans[at++];
      std::error_code error;
      if (scan == "-" || is_recording(scan) || fs::is_directory(scan, error)) {
        FeatureOptions data = o.feature;
        data.data = scan;
        stream = open_source(data, {}, std::nullopt).next;
        continue;
      }
      ScanRef one;
      one.file = scan;
      one.frame = static_cast<int>(at) - 1;
      one.time = time_in_name(scan);
      if (one.frame % o.feature.every == 0) return one;
    }
  };
}

/// The first scans show the sensor.
std::pair<Dataset, ScanStream> with_first(ScanStream next) {
  Dataset some;
  while (some.scans.size() < kShowSensor) {
    std::optional<ScanRef> scan = next();
    if (!scan) break;
    some.scans.push_back(std::move(*scan));
  }
  std::vector<ScanRef> first = some.scans;
  return {std::move(some), chained(std::move(first), std::move(next))};
}

int locate_scans(LocateOptions& o) {
  auto [some, next] = with_first(scans_of(o));
  if (some.scans.empty()) throw UsageError("SCAN: there are no scans");
  auto store = open_map(o.map, MapAccess::kRead);
  MapSource source = map_source(o.feature, some, feature_key_of(store->fingerprint()));
  source.options.hnsw_candidates = o.feature.graph_candidates();
  source.options.local_map = local_map_of(store->fingerprint());
  if (source.options.local_map != 0)
    warn(str(display_name(o.map), ": has local maps of ", source.options.local_map,
             " m; give accumulated clouds, because a single scan covers less"));
  Map map(source.extractor, source.options, std::move(store), warn);
  LoopDetector detector(map, {.verify = o.no_verify ? std::optional(false) : std::nullopt,
                              .threshold = o.threshold,
                              .target_precision = o.target_precision,
                              .warn = warn});
  LoopWriter writer(std::cout, o.format);
  PointCloud cloud;
  bool skipped = false;
  while (const std::optional<ScanRef> scan = next()) {
    if (interrupted()) throw Interrupted("interrupted");
    std::vector<Detection> places;
    std::string error;
    try {
      read_scan_into(*scan, cloud);
      places = detector.locate(view_of(cloud));
      error = places.front().error;
      if (!places.front().loop && error.empty()) error = "the map is empty";
      if (!error.empty()) error = str(scan->file.string(), ": ", error);
    } catch (const InputError& failed) {
      error = failed.what();
    }
    if (!error.empty()) {
      warn_skipped(error);
      skipped = true;
      continue;
    }
    for (Detection& place : places)
      writer.write(line_of({.scan = *scan, .found = std::move(place)}, ""));
  }
  return skipped ? kScansSkipped : kOk;
}

}  // namespace

Command locate_command() {
  return {
      "locate", "where in a map single scans were taken",
      "Registers each scan, whose pose is unknown, with the most similar places of the map and "
      "prints its pose. If none is certain, prints up to three lines, the best first. "
      "The map does not change. SCAN is a file, or scans in any form that `revisit loops` reads.",
      "  revisit locate town.map scan.bin\n"
      "  revisit locate town.map drive.bag --every 10 --format jsonl\n",
      with_options<LocateOptions>(locate_scans)};
}

}  // namespace revisit::cli
