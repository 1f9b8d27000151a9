#include <algorithm>
#include <iostream>
#include <set>

#include "cli/command.h"
#include "cli/messages.h"
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
  std::vector<std::string> drives;
  bool dry_run = false;

  void declare(Options& options) {
    options.argument("MAP", &file)
        .group("Entries to remove (all conditions must hold):")
        .option("drive", "NAME", "drive of the entry; repeatable", &drives);
  }
  void declare_dry_run(Options& options) {
    options.group("Output:").flag("dry-run", "number of entries only; nothing is removed",
                                  &dry_run);
  }

  std::unique_ptr<MapStore> open() const {
    return open_map(file, dry_run ? MapAccess::kRead : MapAccess::kWrite);
  }
  bool is_of_the_drives(const StoredPlace& place) const {
    return drives.empty() || std::ranges::count(drives, place.drive) > 0;
  }
  void carry_out(MapStore& map, const std::vector<int64_t>& ids) const {
    const int64_t before = map.size();
    const int64_t n = dry_run ? static_cast<int64_t>(ids.size()) : map.remove(ids);
    std::cout << display_name(file) << ": " << n << " of " << before << " entries "
              << (dry_run ? "would be" : "were") << " removed, " << before - n << " remain\n";
  }
};

/// Drops descriptors. Returns the largest id so far.
int64_t read_places(const MapStore& map, std::vector<StoredPlace>& places) {
  const auto take = [&](StoredPlace&& place) {
    std::vector<float>().swap(place.descriptor);
    std::vector<float>().swap(place.feature);
    places.push_back(std::move(place));
  };
  return map.read(0, take, warn).last;
}

struct RemoveOptions {
  Removal removal;
  std::string ids_given, near;
  std::optional<double> radius;

  void declare(Options& options) {
    removal.declare(options);
    options.option("ids", "ID,...", "ids, e.g. 3,7-9, also of corrupt entries", &ids_given)
        .option("near", "X,Y,Z", "center [m] of the region, in the frame of `revisit map places`",
                &near)
        .option("radius", "M", "radius [m] around --near", &radius)
        .at_least(0);
    removal.declare_dry_run(options);
  }
};

int remove_entries(RemoveOptions& o) {
  if (o.near.empty() != !o.radius) throw UsageError("--near and --radius: give both or neither");
  if (o.ids_given.empty() && o.near.empty() && o.removal.drives.empty())
    throw UsageError("missing a condition: give --ids, --drive, or --near with --radius");
  const Eigen::Vector3d center = o.near.empty() ? Eigen::Vector3d::Zero() : point_of(o.near);

  const auto map = o.removal.open();
  std::vector<StoredPlace> places;
  const int64_t most = read_places(*map, places);
  std::set<int64_t> chosen;
  if (!o.ids_given.empty()) chosen = ids_of(o.ids_given, most);
  if (!o.near.empty() || !o.removal.drives.empty()) {
    const std::set<int64_t> requested = std::move(chosen);
    chosen.clear();
    for (const StoredPlace& place : places)
      if ((o.ids_given.empty() || requested.contains(place.id)) &&
          o.removal.is_of_the_drives(place) &&
          (o.near.empty() ||
           (place.pose && (place.pose->translation() - center).norm() <= *o.radius)))
        chosen.insert(place.id);
  }
  for (const int64_t id : map->removed()) chosen.erase(id);
  o.removal.carry_out(*map, {chosen.begin(), chosen.end()});
  return kOk;
}

struct PruneOptions {
  Removal removal;
  std::optional<double> days, before;

  void declare(Options& options) {
    removal.declare(options);
    options
        .option(
            "older", "DAYS",
            "minimum age in days relative to the newest entry of the map, or of the given drives",
            &days)
        .at_least(0)
        .option("before", "TIME", "end of the times to remove [s], as in `revisit map places`",
                &before);
    removal.declare_dry_run(options);
  }
};

int prune(PruneOptions& o) {
  if (o.days.has_value() == o.before.has_value())
    throw UsageError("expected one of --older DAYS and --before TIME, found ",
                     o.days ? "both" : "none");
  if (o.days && !(*o.days >= 0))
    throw UsageError("--older: expected a number of o.days, found ", *o.days);

  const auto map = o.removal.open();
  std::vector<StoredPlace> places;
  read_places(*map, places);
  std::optional<double> newest;
  int64_t timeless = 0;
  for (const StoredPlace& place : places) {
    if (!o.removal.is_of_the_drives(place)) continue;  // the clocks of other drives may differ
    if (place.time) newest = std::max(newest.value_or(*place.time), *place.time);
    timeless += place.time ? 0 : 1;
  }
  if (o.days && newest) o.before = *newest - *o.days * kSecondsADay;
  std::vector<int64_t> old;
  for (const StoredPlace& place : places)
    if (place.time && *place.time < o.before && o.removal.is_of_the_drives(place))
      old.push_back(place.id);
  if (timeless > 0) warn(str(timeless, " entries have no time and remain"));
  o.removal.carry_out(*map, old);
  return kOk;
}

}  // namespace

Command map_remove_command() {
  return {"remove", "remove entries by id, drive or position",
          "Removes entries from a map. Their ids are not used again. To replace places that "
          "changed, describe them again with `revisit loops --map` or `revisit map build`.",
          "  revisit map remove town.map --ids 3,7-9\n"
          "  revisit map remove town.map --drive monday --near 120,0,-35 --radius 20 --dry-run\n",
          with_options<RemoveOptions>(remove_entries)};
}

Command map_prune_command() {
  return {"prune", "remove old entries",
          "Removes old entries from a map, by the times of their scans.",
          "  revisit map prune town.map --older 30\n"
          "  revisit map prune town.map --before $(date -d 2026-11-01 +%s) --dry-run\n",
          with_options<PruneOptions>(prune)};
}

}  // namespace revisit::cli
