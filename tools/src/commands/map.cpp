#include <algorithm>
#include <iostream>
#include <iterator>
#include <limits>
#include <set>

#include "cli/built_in.h"
#include "cli/command.h"
#include "cli/terminal.h"
#include "revisit/maps/map_store.h"
#include "revisit/recognition/calibration.h"
#include "revisit/registration/registration.h"

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
  table.row(
      {"dimensions", dimensions ? str(*dimensions) : "unknown before the descriptor projection"});
  for (const auto& [name, value] : map->fingerprint()) table.row({name, value});
  const auto add = [&](const char* what, const char* name, const auto& text_of) {
    std::string text = "corrupt";
    try {
      text = text_of(map->value(name).value_or(""));
    } catch (const InputError&) {  // shown as corrupt
    }
    if (!text.empty()) table.row({what, text});
  };
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

/// Reports points that have their checksum, but are not those of a scan.
void check_clouds(const MapStore& map, std::vector<std::string>& problems) {
  std::vector<int64_t> ids;
  const auto ignore = [](const std::string&) {};  // check_map() reports it
  map.read(
      0, [&](MapEntry&& entry) { ids.push_back(entry.id); }, ignore);
  for (const int64_t id : ids) {
    std::string cloud;
    try {
      cloud = map.cloud(id);
    } catch (const InputError&) {  // a wrong checksum, which check_map() reports
    }
    try {
      if (!cloud.empty()) expand_cloud(cloud);
    } catch (const InputError& error) {
      problems.push_back(str(map.name(), ": entry ", id, ": ", error.what()));
    }
  }
}

int print_info(const InfoOptions& o) {
  if (o.check) {
    std::vector<std::string> problems = check_map(o.file);
    try {
      check_clouds(*open_map(o.file, MapAccess::kRead), problems);
    } catch (const InputError&) {  // reported by check_map()
    }
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

constexpr double kSecondsADay = 86400;

/// "3,7-9" is 3, 7, 8 and 9.
std::set<int64_t> ids_of(const std::string& text, int64_t most) {
  std::set<int64_t> ids;
  for (const std::string& part : comma_separated(text)) {
    const size_t dash = part.find('-', 1);
    const auto first = parse_value<int64_t>("--ids", part.substr(0, dash));
    const auto last =
        dash == std::string::npos ? first : parse_value<int64_t>("--ids", part.substr(dash + 1));
    if (first < 1 || last < first || last > most)
      throw UsageError("--ids: '", part, "' is outside of the map's ids (expected 1 to ", most,
                       ")");
    for (int64_t id = first; id <= last; ++id) ids.insert(id);
  }
  return ids;
}

Eigen::Vector3d point_of(const std::string& text) {
  const std::vector<std::string> parts = comma_separated(text);
  if (parts.size() != 3) throw UsageError("--near: expected X,Y,Z, found '", text, "'");
  Eigen::Vector3d point;
  for (int axis = 0; axis < 3; ++axis) point[axis] = parse_value<double>("--near", parts[axis]);
  return point;
}

struct Removal {
  fs::path file;
  std::string ids, near;
  std::vector<std::string> drives;
  std::string older;
  std::optional<double> radius;
  bool dry_run = false;

  void declare(Options& options) {
    options.argument("MAP", &file)
        .group("Entries to remove (all conditions must hold):")
        .option("drive", "NAME", "drive of the entry; repeatable", &drives)
        .option("ids", "ID,...", "ids, e.g. 3,7-9, also of corrupt entries", &ids)
        .option("near", "X,Y,Z", "center [m] of the region, in the frame of the map's poses", &near)
        .needs("radius")
        .option("radius", "METERS", "radius around --near", &radius)
        .at_least(0)
        .needs("near")
        .option("older", "DAYS|@TIME",
                "minimum age in days relative to the newest entry of the map, or of the given "
                "drives; @: end of the times to remove [s]",
                &older)
        .group("Output:")
        .flag("dry-run", "number of entries only; nothing is removed", &dry_run)
        .check([this] {
          if (ids.empty() && !has_conditions())
            throw UsageError(
                "missing a condition: give --ids, --drive, --older, or --near with --radius");
        });
  }
  bool has_conditions() const { return !near.empty() || !drives.empty() || !older.empty(); }
  bool is_of_the_drives(const MapEntry& entry) const {
    return drives.empty() || std::ranges::count(drives, entry.drive) > 0;
  }
};

/// Entries without descriptors. Sets `last` to the largest id so far.
std::vector<MapEntry> read_entries(const MapStore& map, int64_t& last) {
  std::vector<MapEntry> entries;
  const auto take = [&](MapEntry&& entry) {
    std::vector<float>().swap(entry.descriptor);
    std::vector<float>().swap(entry.feature);
    entries.push_back(std::move(entry));
  };
  last = map.read(0, take, warn).last;
  return entries;
}

/// End of the times to remove. Other drives do not count, because their clocks may differ.
std::optional<double> end_of_old(const std::vector<MapEntry>& entries, const Removal& removal) {
  if (removal.older.empty()) return std::nullopt;
  if (removal.older[0] == '@') return parse_value<double>("--older", removal.older.substr(1));
  const auto days = parse_value<double>("--older", removal.older);
  if (!(days >= 0)) throw UsageError("--older: expected at least 0 days, found ", days);
  std::optional<double> newest;
  for (const MapEntry& entry : entries)
    if (entry.time && removal.is_of_the_drives(entry))
      newest = std::max(newest.value_or(*entry.time), *entry.time);
  if (!newest) return -std::numeric_limits<double>::infinity();
  return *newest - days * kSecondsADay;
}

void check_drives(const std::vector<std::string>& drives, const std::vector<MapEntry>& entries) {
  std::set<std::string> there;
  for (const MapEntry& entry : entries) there.insert(entry.drive);
  for (const std::string& drive : drives)
    if (!there.contains(drive))
      throw UsageError("--drive: the map has no entries of '", drive, "'",
                       nearest_name_hint(drive, {there.begin(), there.end()}),
                       "; its drives: ", joined(there, ", "));
}

std::set<int64_t> chosen_by(const Removal& removal, const MapStore& map) {
  int64_t last = 0;
  const std::vector<MapEntry> entries = read_entries(map, last);
  const std::set<int64_t> requested = ids_of(removal.ids, last);
  check_drives(removal.drives, entries);
  if (!removal.has_conditions()) return requested;
  const std::optional<double> end = end_of_old(entries, removal);
  const Eigen::Vector3d center =
      removal.near.empty() ? Eigen::Vector3d::Zero() : point_of(removal.near);
  std::set<int64_t> chosen;
  int64_t timeless = 0;
  for (const MapEntry& entry : entries) {
    const bool is_near =
        removal.near.empty() ||
        (entry.pose && (entry.pose->translation() - center).norm() <= *removal.radius);
    if (!is_near || !removal.is_of_the_drives(entry) ||
        (!removal.ids.empty() && !requested.contains(entry.id)))
      continue;
    timeless += end && !entry.time ? 1 : 0;
    if (!end || (entry.time && *entry.time < *end)) chosen.insert(entry.id);
  }
  if (chosen.empty()) note("no entry meets all conditions");
  if (timeless > 0) warn(str(timeless, " entries have no time and remain"));
  return chosen;
}

int remove_entries(const Removal& removal) {
  const auto map = open_map(removal.file, removal.dry_run ? MapAccess::kRead : MapAccess::kWrite);
  std::set<int64_t> chosen = chosen_by(removal, *map);
  for (const int64_t id : map->removed()) chosen.erase(id);
  const int64_t before = map->size();
  const std::vector<int64_t> ids(chosen.begin(), chosen.end());
  const int64_t n = removal.dry_run ? std::ssize(ids) : map->remove(ids);
  std::cout << display_name(removal.file) << ": " << n << " of " << before << " entries "
            << (removal.dry_run ? "would be" : "were") << " removed, " << before - n << " remain\n";
  return kOk;
}

Command remove() {
  return {"remove", "remove entries by id, drive, position or age",
          "Removes entries from a map. Their ids are not used again. To replace places that "
          "changed, describe them again with `revisit loops --map` or `revisit map build`.",
          "  revisit map remove town.map --ids 3,7-9\n"
          "  revisit map remove town.map --drive monday --near 120,-35,0 --radius 20 --dry-run\n"
          "  revisit map remove town.map --older 30\n",
          with_options<Removal>(remove_entries)};
}

}  // namespace

Command map_command() {
  return {"map",
          "maps: build, merge, export, info, remove",
          "Maps of `revisit loops --map` and of `revisit map build`.\n",
          "",
          {},
          {map_build_command(), merge(), map_export_command(), info(), remove()}};
}

}  // namespace revisit::cli
