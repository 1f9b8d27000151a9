#include <algorithm>
#include <iostream>
#include <set>

#include "cli/messages.h"
#include "cli/parser.h"
#include "revisit/maps/map_store.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;
using pipeline::MapAccess;
using pipeline::StoredPlace;

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
      throw UsageError("--ids: '", part, "' are not ids of this map, which are 1 to ", most);
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

  void declare(Parser& parser) {
    parser.positional("MAP", &file)
        .group("Places, of which those are removed that fit all that is given:")
        .option("drive", "NAME", "of this drive; may be given several times", &drives);
  }
  void declare_dry_run(Parser& parser) {
    parser.group("Output:").flag("dry-run", "only print how many it would be", &dry_run);
  }

  std::unique_ptr<pipeline::MapStore> open() const {
    return pipeline::open_map(file, dry_run ? MapAccess::kRead : MapAccess::kWrite);
  }
  bool is_of_the_drives(const StoredPlace& place) const {
    return drives.empty() || std::ranges::count(drives, place.drive) > 0;
  }
  void carry_out(pipeline::MapStore& map, const std::vector<int64_t>& ids) const {
    const int64_t before = map.size();
    const int64_t n = dry_run ? static_cast<int64_t>(ids.size()) : map.remove(ids);
    std::cout << pipeline::shown_name(file) << ": " << n << " of " << before << " places "
              << (dry_run ? "would be" : "were") << " removed, " << before - n << " stay\n";
  }
};

/// Reads a map without its descriptors. Returns how many places it has had.
int64_t read_places(const pipeline::MapStore& map, std::vector<StoredPlace>& places) {
  const auto take = [&](StoredPlace&& place) {
    std::vector<float>().swap(place.descriptor);
    std::vector<float>().swap(place.feature);
    places.push_back(std::move(place));
  };
  return map.read(0, take, warn).last;
}

}  // namespace

int map_remove_command(const Arguments& arguments) {
  Removal removal;
  std::string ids_given, near;
  std::optional<double> radius;
  Parser parser(
      "revisit map remove", "MAP",
      "Removes places from a map: no scan is recognised as them any more. Their ids are not given "
      "again. Places that are described anew, with `revisit loops --map` or `revisit map build`, "
      "replace them.",
      "  revisit map remove town.map --ids 3,7-9\n"
      "  revisit map remove town.map --drive monday --near 120,0,-35 --radius 20 --dry-run\n");
  removal.declare(parser);
  parser
      .option("ids", "ID,...", "with these ids, e.g. 3,7-9; places that are damaged, too",
              &ids_given)
      .option("near", "X,Y,Z",
              "no farther than --radius from this point: [m], as `revisit map places` prints them",
              &near)
      .option("radius", "M", "with --near: how far [m]", &radius);
  removal.declare_dry_run(parser);
  parser.parse(arguments);
  if (near.empty() != !radius) throw UsageError("--near and --radius: give both or neither");
  if (radius && !(*radius >= 0))
    throw UsageError("--radius: expected a distance in metres, found ", *radius);
  if (ids_given.empty() && near.empty() && removal.drives.empty())
    throw UsageError("say which places: --ids, --drive or --near with --radius");
  const Eigen::Vector3d centre = near.empty() ? Eigen::Vector3d::Zero() : point_of(near);

  const auto map = removal.open();
  std::vector<StoredPlace> places;
  const int64_t most = read_places(*map, places);
  std::set<int64_t> chosen;
  if (!ids_given.empty()) chosen = ids_of(ids_given, most);
  if (!near.empty() || !removal.drives.empty()) {
    const std::set<int64_t> asked = std::move(chosen);
    chosen.clear();
    for (const StoredPlace& place : places)
      if ((ids_given.empty() || asked.contains(place.id)) && removal.is_of_the_drives(place) &&
          (near.empty() || (place.pose && (place.pose->translation() - centre).norm() <= *radius)))
        chosen.insert(place.id);
  }
  for (const int64_t id : map->removed()) chosen.erase(id);
  removal.carry_out(*map, {chosen.begin(), chosen.end()});
  return kOk;
}

int map_forget_command(const Arguments& arguments) {
  Removal removal;
  std::optional<double> days, before;
  Parser parser("revisit map forget", "MAP",
                "Removes the places of a map that are old, by the times of their scans.",
                "  revisit map forget town.map --older 30\n"
                "  revisit map forget town.map --before $(date -d 2026-11-01 +%s) --dry-run\n");
  removal.declare(parser);
  parser
      .option("older", "DAYS",
              "more than so many days older than the newest place of the map, or of the drives "
              "given",
              &days)
      .option("before", "TIME", "from before this time [s], as `revisit map places` prints them",
              &before);
  removal.declare_dry_run(parser);
  parser.parse(arguments);
  if (days.has_value() == before.has_value())
    throw UsageError("say which places are old: --older DAYS or --before TIME");
  if (days && !(*days >= 0)) throw UsageError("--older: expected a number of days, found ", *days);

  const auto map = removal.open();
  std::vector<StoredPlace> places;
  read_places(*map, places);
  std::optional<double> newest;
  int64_t timeless = 0;
  for (const StoredPlace& place : places) {
    if (!removal.is_of_the_drives(place)) continue;  // others' clocks may differ
    if (place.time) newest = std::max(newest.value_or(*place.time), *place.time);
    timeless += place.time ? 0 : 1;
  }
  if (days && newest) before = *newest - *days * kSecondsADay;
  std::vector<int64_t> old;
  for (const StoredPlace& place : places)
    if (place.time && *place.time < before && removal.is_of_the_drives(place))
      old.push_back(place.id);
  if (timeless > 0) warn(str(timeless, " places have no time, and stay"));
  removal.carry_out(*map, old);
  return kOk;
}

}  // namespace revisit::cli
