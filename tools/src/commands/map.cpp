#include <algorithm>
#include <iostream>
#include <iterator>

#include "cli/built_in.h"
#include "cli/command.h"
#include "cli/table.h"
#include "cli/terminal.h"
#include "loops/build_map.h"
#include "loops/loop_writer.h"
#include "loops/map_options.h"
#include "loops/open_recognizer.h"
#include "loops/recording.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/maps/map_store.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

struct InfoOptions {
  fs::path file;
  bool check = false, entries = false;

  void declare(Options& options) {
    options.argument("FILE", &file)
        .flag("check",
              "read all of the map and print its corrupt parts; exit code 5 if there are any",
              &check)
        .flag("entries", "entries as CSV: id, drive, frame, time [s] and position [m]", &entries)
        .check([this] { need_built_in_for_map("revisit map info", file); });
  }
};

void print_configuration(const fs::path& file, bool checked) {
  const auto map = open_map(file, MapAccess::kRead);
  Table table({"map", display_name(file)});
  table.row({"entries", str(map->size())});
  table.row({"removed", str(map->removed().size())});
  table.row({"dtype", name_of(map->descriptor_type())});
  const auto dimensions = map->dimensions();
  table.row({"dimensions", dimensions ? str(*dimensions) : "no entry yet"});
  for (const auto& [name, value] : map->fingerprint()) table.row({name, value});
  const auto add = [&](const char* what, const char* name, const auto& text_of) {
    std::string text = "corrupt";
    try {
      text = text_of(map->value(name).value_or(""));
    } catch (const InputError&) {  // shown as corrupt
    }
    if (!text.empty()) table.row({what, text});
  };
  add("threshold", kThresholdValue, [](const std::string& content) { return content; });
  for (const auto& [what, name] : {std::pair("calibration", kVerifiedCalibrationValue),
                                   std::pair("calibration, not registered", kCalibrationValue)})
    add(what, name, [what = what](const std::string& content) {
      return content.empty() ? "none of its own" : parse_calibration(content, what).trained_on;
    });
  add("descriptor projection", kProjectionValue, [](const std::string& content) {
    return content.empty() ? "not estimated yet" : "estimated";
  });
  if (checked) table.row({"check", "valid"});
  table.print(std::cout);
}

int print_entries(const fs::path& file) {
  const auto map = open_map(file, MapAccess::kRead);
  Table({"id", "drive", "frame", "time", "x", "y", "z"}).print_csv(std::cout);
  bool corrupt = false;
  map->read(
      0,
      [](MapEntry&& entry) {
        const auto coordinate = [&](int axis) {
          return entry.pose ? number(entry.pose->translation()[axis], 3) : "";
        };
        Table({str(entry.id), entry.drive, str(entry.frame),
               entry.time ? number(*entry.time, 6) : "", coordinate(0), coordinate(1),
               coordinate(2)})
            .print_csv(std::cout);
      },
      [&](const std::string& message) {
        corrupt = true;
        std::cerr << "revisit: " << message << "\n";
      });
  return corrupt ? kCheckFailed : kOk;
}

int print_info(const InfoOptions& o) {
  if (o.check) {
    const std::vector<std::string> problems = check_map(o.file);
    for (const std::string& problem : problems) std::cout << problem << "\n";
    if (!problems.empty()) return kCheckFailed;
  }
  if (o.entries) return print_entries(o.file);
  print_configuration(o.file, o.check);
  return kOk;
}

Command info() {
  return {"info", "configuration and content of a map; find corrupt entries",
          "Prints the configuration and the content of a map.",
          "  revisit map info town.map\n"
          "  revisit map info town.map --entries > entries.csv\n",
          with_options<InfoOptions>(print_info)};
}

struct MergeOptions {
  std::vector<fs::path> maps;
  fs::path output;

  void declare(Options& options) {
    options.argument("MAP", &maps)
        .option("output", "FILE", "file of the new map", &output, 'o')
        .required();
  }
};

int merge_all(MergeOptions& o) {
  for (const fs::path& map : o.maps) need_built_in_for_map("revisit map merge", map);
  need_built_in_for_map("--output", o.output);
  if (o.maps.size() < 2) throw UsageError("MAP: expected at least two maps, found ", o.maps.size());
  const int64_t entries = merge_maps(o.maps, o.output, warn);
  std::cout << display_name(o.output) << ": " << entries << " entries\n";
  return kOk;
}

Command merge() {
  return {"merge", "one map from several",
          "Merges maps into a new one. All must have one descriptor projection: a new map takes it "
          "over with `revisit loops --projection-from`.",
          "  revisit map merge monday.map tuesday.map -o week.map\n",
          with_options<MergeOptions>(merge_all)};
}

struct BuildOptions {
  FeatureOptions feature;
  MapOptions map;

  void declare(Options& options) {
    feature.declare(options, Scans::kOneByOne);
    map.declare(options);
    options.check([this] {
      if (map.file.empty()) throw UsageError("missing required option --map FILE");
    });
  }
};

int build_all(BuildOptions& o) {
  const Dataset dataset = open_scans(o.feature);
  RecognizerSource source = recognizer_source(o.feature, dataset, o.map.file, ScansAtOnce::kMany);
  source.options.warmup = o.map.warmup;
  const NewMap new_map(o.map.file);
  PlaceRecognizer recognizer(source.extractor, source.options, o.map.open(source), warn);
  cli::Progress progress("describing", "scans", !o.feature.quiet);
  const auto shared = open_work_queue(o.map.file);
  BuildMap how;
  const std::vector<ScanRef> scans = with_sensor_poses(dataset);
  how.drive = drive_of_recording(scans, recognizer, o.map.drive_of(dataset));
  if (how.drive != o.map.drive_of(dataset) && !o.feature.quiet)
    note(str("the map has another recording '", o.map.drive_of(dataset),
             "'; this one is stored as '", how.drive, "'"));
  how.shared = shared.get();
  how.keep_clouds = !o.map.no_clouds;
  how.threads = o.feature.thread_count();
  how.stop = interrupted;
  how.done = [&](int64_t done, int64_t all) { progress.update(done, all); };
  how.skipped = warn_skipped;
  const Built built = build_map(scans, recognizer, how);
  if (!o.feature.quiet)
    std::cout << display_name(o.map.file) << ": " << recognizer.size() << " entries, "
              << built.added << " added by this process"
              << (built.skipped > 0 ? str(", ", built.skipped, " scans skipped") : "") << "\n";
  return built.skipped > 0 ? kScansSkipped : kOk;
}

Command build() {
  return {"build", "describe a data set and add it to a map",
          "Describes the scans that a map lacks and adds them. Any number of processes and "
          "machines can fill a map on a server together: each claims some scans at a time, and the "
          "others take over the claims of a process that ends. If interrupted, run the same "
          "command again to resume.",
          "  revisit map build town --map town.map\n"
          "  revisit map build town --map 'postgresql://robot@server/maps?map=town'\n",
          with_options<BuildOptions>(build_all)};
}

struct QueryOptions {
  FeatureOptions feature;
  fs::path map;
  std::vector<fs::path> scans;
  std::optional<double> threshold;
  double precision = RecognizerOptions().target_precision;
  std::string format = "csv";

  void declare(Options& options) {
    options.argument("MAP", &map).argument("SCAN", &scans);
    feature.declare_data(options);
    feature.declare_describing(options, Scans::kOneByOne);
    options.group("Query:")
        .option("threshold", "S",
                "minimum score of an accepted match (default: from --target-precision)", &threshold)
        .excludes({"target-precision"})
        .common()
        .option("target-precision", "P",
                str("fraction of accepted matches that are correct, 0 to 1, by the calibration of "
                    "the map or the ring "
                    "model (default ",
                    precision, ")"),
                &precision)
        .common()
        .format({"csv", "jsonl"}, &format)
        .common();
  }
};

int query_scans(QueryOptions& o) {
  need_built_in_for_map("revisit map query", o.map);
  Dataset dataset;
  for (const fs::path& scan : o.scans) {
    if (std::error_code error; is_recording(scan) || fs::is_directory(scan, error)) {
      o.feature.data = scan;
      std::ranges::move(open_scans(o.feature).scans, std::back_inserter(dataset.scans));
      continue;
    }
    dataset.scans.emplace_back().file = scan;
    dataset.scans.back().frame = static_cast<int>(dataset.scans.size()) - 1;
  }
  std::erase_if(dataset.scans,
                [&](const ScanRef& scan) { return scan.frame % o.feature.every != 0; });
  RecognizerSource source = recognizer_source(o.feature, dataset, o.map);
  source.options.threshold = o.threshold;
  source.options.target_precision = o.precision;
  source.options.local_map =
      PlaceRecognizer::local_map_of(open_map(o.map, MapAccess::kRead)->fingerprint());
  if (source.options.local_map != 0)
    warn(str(display_name(o.map), ": has local maps of ", source.options.local_map,
             " m; query it with accumulated clouds, because a single scan covers less"));
  const MapFingerprint fingerprint =
      PlaceRecognizer::fingerprint_of(source.extractor, source.options);
  const PlaceRecognizer recognizer(source.extractor, source.options,
                                   open_map(o.map, MapAccess::kRead, &fingerprint), warn);
  LoopWriter writer(std::cout, o.format);
  bool skipped = false;
  for (const ScanRef& scan : dataset.scans) {
    Visit visit{.scan = scan};
    const PointCloud cloud = read_scan(scan);
    const Description description = recognizer.describe(view_of(cloud));
    visit.found.loop = recognizer.query(description);
    if (visit.found.loop) {
      writer.write(line_of(visit, ""));
      continue;
    }
    skipped = true;
    warn(scan.file.string() + ": " +
         (description.described() ? "the map is empty" : description.error));
  }
  return skipped ? kScansSkipped : kOk;
}

Command query() {
  return {"query", "most similar map entry for each scan",
          "Prints the most similar map entry for each scan. SCAN is a file, or scans in any form "
          "that `revisit loops` reads from files.",
          "  revisit map query town.map scan.bin\n"
          "  revisit map query town.map drive.bag --every 10\n",
          with_options<QueryOptions>(query_scans)};
}

}  // namespace

Command map_command() {
  return {"map",
          "maps: build, query, merge, info, remove",
          "Maps of `revisit loops --map` and of `revisit map build`.\n",
          "",
          {},
          {build(), query(), merge(), info(), map_remove_command()}};
}

}  // namespace revisit::cli
