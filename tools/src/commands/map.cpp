#include <iostream>

#include "cli/built_in.h"
#include "cli/command.h"
#include "cli/interrupt.h"
#include "cli/messages.h"
#include "cli/progress.h"
#include "cli/table.h"
#include "loops/build_map.h"
#include "loops/loop_writer.h"
#include "loops/map_options.h"
#include "loops/open_recognizer.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/maps/map_store.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

fs::path one_map(const char* command, const char* summary, const Arguments& arguments) {
  fs::path file;
  Parser parser(command, "FILE", summary, str("  ", command, " town.map\n"));
  parser.positional("FILE", &file);
  parser.parse(arguments);
  need_built_in_for_map(command, file);
  return file;
}

int info(const Arguments& arguments) {
  const fs::path file =
      one_map("revisit map info", "Prints the configuration and the content of a map.", arguments);
  const auto map = open_map(file, MapAccess::kRead);
  Table table({"map", display_name(file)});
  table.row({"entries", str(map->size())});
  table.row({"removed", str(map->removed().size())});
  table.row({"dtype", map->descriptor_type() == DescriptorType::kFloat16 ? "float16" : "float32"});
  const std::map<std::string, std::string> shown = {
      {"recogniser", "recognizer version"}, {"made by", "feature key"}, {"numbers", "dimensions"}};
  for (const auto& [name, value] : map->fingerprint())
    table.row({shown.contains(name) ? shown.at(name) : name, value});
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
  table.print(std::cout);
  return kOk;
}

int check(const Arguments& arguments) {
  const fs::path file = one_map("revisit map check",
                                "Reads all of a map and prints its corrupt parts. Exit code 5 if "
                                "there are any.",
                                arguments);
  const std::vector<std::string> wrong = check_map(file);
  for (const std::string& line : wrong) std::cout << line << "\n";
  if (wrong.empty()) std::cout << display_name(file) << ": valid\n";
  return wrong.empty() ? kOk : kCheckFailed;
}

int places(const Arguments& arguments) {
  const fs::path file =
      one_map("revisit map places",
              "Prints the entries of a map as CSV: drive, frame, time and position.", arguments);
  const auto map = open_map(file, MapAccess::kRead);
  Table({"id", "drive", "frame", "time", "x", "y", "z"}).print_csv(std::cout);
  bool corrupt = false;
  map->read(
      0,
      [](StoredPlace&& place) {
        const auto coordinate = [&](int axis) {
          return place.pose ? number(place.pose->translation()[axis], 3) : "";
        };
        Table({str(place.id), place.drive, str(place.frame),
               place.time ? number(*place.time, 6) : "", coordinate(0), coordinate(1),
               coordinate(2)})
            .print_csv(std::cout);
      },
      [&](const std::string& message) {
        corrupt = true;
        std::cerr << "revisit: " << message << "\n";
      });
  return corrupt ? kCheckFailed : kOk;
}

int merge(const Arguments& arguments) {
  std::vector<fs::path> maps;
  fs::path output;
  Parser parser("revisit map merge", "MAP... -o FILE",
                "Merges maps into a new one. All must have one descriptor projection: a new map "
                "takes it over with "
                "`revisit loops --basis-from`.",
                "  revisit map merge monday.map tuesday.map -o week.map\n");
  parser.optional_positional("MAP", &maps)
      .option("output", "FILE", "file of the new map", &output, 'o');
  parser.parse(arguments);
  for (const fs::path& map : maps) need_built_in_for_map("revisit map merge", map);
  need_built_in_for_map("--output", output);
  if (maps.size() < 2) throw UsageError("MAP: expected at least two maps, found ", maps.size());
  if (output.empty()) throw UsageError("missing required option --output FILE, the new map");
  const int64_t places = merge_maps(maps, output, warn);
  std::cout << display_name(output) << ": " << places << " entries\n";
  return kOk;
}

int build(const Arguments& arguments) {
  FeatureOptions options;
  options.feature = "ring";
  MapOptions map;
  Parser parser("revisit map build", "DATA",
                "Describes the scans that a map lacks and adds them. Any number of processes and "
                "machines can fill a map on a "
                "server together: each claims some scans at a time, and the others take over the "
                "claims of a process that "
                "ends. If interrupted, run the same command again to resume.",
                "  revisit map build town --map town.map\n"
                "  revisit map build town --map 'postgresql://robot@server/maps?map=town'\n");
  options.declare(parser, Scans::kOneByOne);
  map.declare(parser);
  parser.common({"map", "drive", "basis-from", "sequence", "every", "sensor", "mount", "no-clouds",
                 "dtype", "threads", "no-progress", "quiet"});
  parser.parse(arguments);
  options.check_given(parser);
  map.check();
  if (map.file.empty()) throw UsageError("missing required option --map FILE");
  const Dataset dataset = open_scans(options);
  RecognizerSource source = recognizer_source(options, dataset, map.file, ScansAtOnce::kMany);
  source.options.warmup = map.warmup;
  const NewMap new_map(map.file);
  PlaceRecognizer recognizer(source.extractor, source.options, map.open(source), warn);
  cli::Progress progress("describing", "scans", !options.no_progress && !options.quiet);
  const auto shared = open_work_queue(map.file);
  BuildMap how;
  const std::vector<ScanRef> scans = with_sensor_poses(dataset);
  how.drive = drive_of_recording(scans, recognizer, map.drive_of(dataset));
  if (how.drive != map.drive_of(dataset) && !options.quiet)
    note(str("the map has another recording '", map.drive_of(dataset), "'; this one is stored as '",
             how.drive, "'"));
  how.shared = shared.get();
  how.keep_clouds = !map.no_clouds;
  how.threads = options.thread_count();
  how.stop = interrupted;
  how.done = [&](int64_t done, int64_t all) { progress.update(done, all); };
  how.skipped = warn_skipped;
  const Built built = build_map(scans, recognizer, how);
  if (!options.quiet)
    std::cout << display_name(map.file) << ": " << recognizer.size() << " entries, " << built.added
              << " added by this process"
              << (built.skipped > 0 ? str(", ", built.skipped, " scans skipped") : "") << "\n";
  return built.skipped > 0 ? kScansSkipped : kOk;
}

int query(const Arguments& arguments) {
  FeatureOptions options;
  options.feature = "ring";
  fs::path map;
  std::vector<fs::path> scans;
  std::optional<double> threshold;
  double precision = RecognizerOptions().target_precision;
  std::string format = "csv";
  Parser parser("revisit map query", "MAP SCAN...",
                "Prints the most similar map entry for each scan.",
                "  revisit map query town.map scan.bin\n");
  options.declare_describing(parser, Scans::kOneByOne);
  parser.positional("MAP", &map)
      .optional_positional("SCAN", &scans)
      .group("Query:")
      .option("threshold", "S",
              "minimum score of an accepted match (default: from --target-precision)", &threshold)
      .option("target-precision", "P",
              str("fraction of accepted matches that are correct, 0 to 1, by the calibration of "
                  "the map or the ring "
                  "model (default ",
                  precision, ")"),
              &precision)
      .choice("format", {"csv", "jsonl"}, "format of the lines, one per scan (default csv)",
              &format);
  parser.common({"sensor", "mount", "threshold", "target-precision", "format", "threads", "quiet"});
  parser.parse(arguments);
  options.check_given(parser);
  need_built_in_for_map("revisit map query", map);
  if (scans.empty()) throw UsageError("missing argument SCAN...: the scans to query");
  Dataset dataset;
  for (const fs::path& scan : scans) {
    dataset.scans.emplace_back().file = scan;
    dataset.scans.back().frame = static_cast<int>(dataset.scans.size()) - 1;
  }
  RecognizerSource source = recognizer_source(options, dataset, map);
  source.options.threshold = threshold;
  source.options.target_precision = precision;
  source.options.local_map =
      PlaceRecognizer::local_map_of(open_map(map, MapAccess::kRead)->fingerprint());
  if (source.options.local_map != 0)
    warn(str(display_name(map), ": has local maps of ", source.options.local_map,
             " m; query it with accumulated clouds, because a single scan covers less"));
  const MapFingerprint identity = PlaceRecognizer::fingerprint_of(source.extractor, source.options);
  const PlaceRecognizer recognizer(source.extractor, source.options,
                                   open_map(map, MapAccess::kRead, &identity), warn);
  LoopWriter writer(std::cout, format);
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

}  // namespace

int map_command(const Arguments& arguments) {
  return dispatch("revisit map", "Maps of `revisit loops --map` and of `revisit map build`.\n",
                  {{"build", "describe a data set and add it to a map", build},
                   {"info", "configuration and content of a map", info},
                   {"places", "entries of a map as CSV", places},
                   {"query", "most similar map entry for each scan", query},
                   {"merge", "one map from several", merge},
                   {"remove", "remove entries by id, drive or position", map_remove_command},
                   {"prune", "remove old entries", map_prune_command},
                   {"check", "find corrupt entries", check}},
                  arguments);
}

}  // namespace revisit::cli
