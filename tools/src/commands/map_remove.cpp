#include <algorithm>
#include <iostream>
#include <limits>
#include <set>

#include "cli/command.h"
#include "cli/terminal.h"
#include "revisit/maps/map_store.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

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
                "missing a condition: give --ids, --drive, --older, or --near with "
                "--radius");
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

std::set<int64_t> chosen_by(const Removal& removal, const MapStore& map) {
  int64_t last = 0;
  const std::vector<MapEntry> entries = read_entries(map, last);
  const std::set<int64_t> requested = ids_of(removal.ids, last);
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

}  // namespace

Command map_remove_command() {
  return {"remove", "remove entries by id, drive, position or age",
          "Removes entries from a map. Their ids are not used again. To replace places that "
          "changed, describe them again with `revisit loops --map` or `revisit map build`.",
          "  revisit map remove town.map --ids 3,7-9\n"
          "  revisit map remove town.map --drive monday --near 120,0,-35 --radius 20 --dry-run\n"
          "  revisit map remove town.map --older 30\n",
          with_options<Removal>(remove_entries)};
}

}  // namespace revisit::cli
