#include <Eigen/Core>
#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "map_format.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/maps/map_store.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

constexpr size_t kEntriesPerTransaction = 1000;

struct Source {
  fs::path file;
  std::unique_ptr<MapStore> map;
};

/// Checksum without the name of the drive, with values rounded to `format`.
int64_t content_of(const MapEntry& entry, DescriptorType format) {
  Checksum sum;
  sum.number(entry.frame);
  std::vector<float> descriptor = entry.descriptor;
  if (format == DescriptorType::kFloat16)
    for (float& x : descriptor) x = static_cast<float>(Eigen::half(x));
  for (const std::vector<float>* numbers : {&std::as_const(descriptor), &entry.feature})
    sum.bytes({reinterpret_cast<const char*>(numbers->data()), numbers->size() * sizeof(float)});
  return sum.value();
}

/// Refers loops to the ids of the merged map; `ids`: by the source's ids. Loops to entries that are
/// not there are dropped.
void renumber(MapEntry& entry, const std::map<int64_t, int64_t>& ids) {
  std::erase_if(entry.loops, [&](MapLoop& loop) {
    const auto place = ids.find(loop.place);
    if (place != ids.end()) loop.place = place->second;
    return place == ids.end();
  });
  std::erase_if(entry.questioned, [&](int64_t& id) {
    const auto other = ids.find(id);
    if (other != ids.end()) id = other->second;
    return other == ids.end();
  });
}

std::vector<Source> open_sources(std::span<const fs::path> maps) {
  if (maps.empty()) throw UsageError("merging maps: expected at least one, found none");
  std::vector<Source> sources;
  for (const fs::path& map : maps) {
    for (const Source& source : sources)
      if (source.file == map ||
          (!is_server_address(map.string()) && !is_server_address(source.file.string()) &&
           fs::exists(map) && fs::equivalent(source.file, map)))
        throw UsageError("merging maps: ", display_name(map), " is given twice");
    sources.push_back({map, open_map(map, MapAccess::kRead,
                                     sources.empty() ? nullptr : &sources[0].map->fingerprint())});
    const auto projection = sources.back().map->value(kProjectionValue),
               first = sources[0].map->value(kProjectionValue);
    if (projection != first)
      throw InputError(display_name(map),
                       !projection ? ": its warm-up is not complete, unlike that of "
                       : !first    ? ": its warm-up is complete, unlike that of "
                                : ": its entries have another descriptor projection than those of ",
                       display_name(maps[0]), "; only a new map can take over a projection");
  }
  return sources;
}

/// Recordings in the merged map. A drive that shares scans with a drive of an earlier map, and
/// has no different scan with the same frame, is the same recording and gets its name. Another
/// recording with a used name becomes MAP/NAME.
class Recordings {
 public:
  using Scans = std::map<int64_t, int64_t>;  // frame -> content

  /// Returns the names of these drives in the merged map.
  std::map<std::string, std::string> add(const Source& source,
                                         const std::map<std::string, Scans>& drives,
                                         const MapStore::Warn& report) {
    std::map<std::string, std::string> names;
    std::set<std::string> assigned;
    for (const auto& [drive, scans] : drives) {
      const std::optional<std::string> known_as = recording_of(source, drive, scans, assigned);
      if (known_as) assigned.insert(*known_as);
      names[drive] = known_as                      ? *known_as
                     : recordings_.contains(drive) ? free_name(source, drive)
                                                   : drive;
      recordings_[names[drive]];  // marks the name as used
      if (!known_as && names[drive] != drive)
        report(str(display_name(source.file), ": drive '", drive, "' becomes '", names[drive],
                   "': another map has a recording of that name"));
    }
    for (const auto& [drive, scans] : drives)
      recordings_[names[drive]].insert(scans.begin(), scans.end());
    return names;
  }

 private:
  static std::string of_map(const Source& source, const std::string& drive) {
    const std::string map =
        is_server_address(source.file.string()) ? "server" : source.file.stem().string();
    return drive.empty() ? map : map + "/" + drive;
  }
  /// Drives of one map may have equal scans.
  std::optional<std::string> recording_of(const Source& source, const std::string& drive,
                                          const Scans& scans,
                                          const std::set<std::string>& assigned) const {
    std::optional<std::string> recording;
    for (const auto& [name, before] : recordings_) {
      bool shares = false, differs = assigned.contains(name);
      for (const auto& [frame, content] : scans)
        if (const auto other = before.find(frame); other != before.end())
          (other->second == content ? shares : differs) = true;
      if (shares && !differs && (!recording || name == drive || name == of_map(source, drive)))
        recording = name;
    }
    return recording;
  }
  std::string free_name(const Source& source, const std::string& drive) const {
    std::string free = of_map(source, drive);
    for (int number = 2; recordings_.contains(free); ++number)
      free = str(of_map(source, drive), "-", number);
    return free;
  }

  std::map<std::string, Scans> recordings_;
};

}  // namespace

std::string projection_of(const fs::path& map, const MapFingerprint& fingerprint) {
  const auto store = open_map(map, MapAccess::kRead, &fingerprint);
  auto projection = store->value(kProjectionValue);
  if (!projection)
    throw InputError(display_name(map),
                     ": warm-up not complete; add more scans before merging (found ", store->size(),
                     " entries)");
  return *std::move(projection);
}

void copy_projection(MapStore& map, const fs::path& other, const MapStore::Warn& warn) {
  const std::optional<std::string> projection = projection_of(other, map.fingerprint());
  const auto own = map.value(kProjectionValue);
  if (own == projection) return;
  const auto reject = [&](const MapEntry&) -> std::vector<float> {
    throw InputError(
        "the map has entries that were not described with the descriptor projection of " +
        display_name(other));
  };
  if (own || map.size() > 0) reject({});
  // As a new revision, so that other processes with an open map use this projection.
  const int64_t revision = map.read(
                                  0, [](MapEntry&&) {}, warn)
                               .revision;
  if (!map.replace_descriptors(reject, {{kProjectionValue, *projection}}, revision) &&
      map.value(kProjectionValue) != projection)  // another process did the same meanwhile
    reject({});
}

int64_t merge_maps(std::span<const fs::path> maps, const fs::path& file,
                   const MapStore::Warn& report) {
  std::vector<Source> sources = open_sources(maps);
  const bool rounded = std::ranges::any_of(sources, [](const Source& source) {
    return source.map->descriptor_type() == DescriptorType::kFloat16;
  });
  const DescriptorType compared = rounded ? DescriptorType::kFloat16 : DescriptorType::kFloat32;
  const MapStore& first = *sources[0].map;
  const auto merged =
      open_map(file, MapAccess::kNew, &first.fingerprint(), first.descriptor_type());
  for (const char* name : {kProjectionValue, kCalibrationValue, kVerifiedCalibrationValue}) {
    const auto value = first.value(name);
    const bool is_common = std::ranges::all_of(sources, [&](const Source& source) {
      return source.map->value(name).value_or("") == value.value_or("");
    });
    if (!is_common)
      report(str("the maps differ in their ", name, "; the merged map gets none"));
    else if (value)
      merged->set_value(name, *value);
  }
  Recordings recordings;
  std::map<int64_t, int64_t> scans;  // content -> id in the merged map
  int64_t last_id = 0;
  for (const Source& source : sources) {
    std::map<std::string, Recordings::Scans> drives;
    const auto list = [&](MapEntry&& entry) {
      const int64_t content = content_of(entry, compared);
      drives[entry.drive].emplace(entry.frame, content);
    };
    const int64_t last = source.map->read(0, list, report).last;
    const auto names = recordings.add(source, drives, report);

    std::vector<MapEntry> entries;
    // A second connection, for use during read()
    const auto clouds = open_map(source.file, MapAccess::kRead);
    int64_t known = 0;
    std::map<int64_t, int64_t> scans_here, ids;
    source.map->read(
        0,
        [&](MapEntry&& entry) {
          if (entry.id > last) return;  // added meanwhile
          const int64_t content = content_of(entry, compared);
          const auto before = scans.find(content);
          ids[entry.id] = before != scans.end() ? before->second : ++last_id;
          if (before != scans.end()) return void(++known);
          scans_here.emplace(content, last_id);
          renumber(entry, ids);
          entry.drive = names.at(entry.drive);
          try {
            entry.cloud = clouds->cloud(entry.id);
          } catch (const InputError& error) {
            report(error.what());
          }
          entries.push_back(std::move(entry));
          if (entries.size() == kEntriesPerTransaction) merged->add(std::exchange(entries, {}));
        },
        [](const std::string&) {});  // reported before
    merged->add(entries);
    scans.merge(scans_here);
    if (known > 0)
      report(str(display_name(source.file), ": ", known,
                 " of its entries are skipped, because earlier maps have them"));
  }
  return merged->size();
}

}  // namespace revisit
