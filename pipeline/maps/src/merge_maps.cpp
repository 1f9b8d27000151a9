#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "checksum.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/maps/map_store.h"

namespace revisit::pipeline {
namespace {

namespace fs = std::filesystem;

constexpr size_t kAtOnce = 1000;  // places a step

}  // namespace

std::string basis_of(const fs::path& map, const MapIdentity& identity) {
  const auto store = open_map(map, MapAccess::kRead, &identity);
  auto basis = store->value(kBasisValue);
  if (!basis)
    throw InputError(shown_name(map), ": its basis is not learnt yet: it has ", store->size(),
                     " places, too few");
  return *std::move(basis);
}

void take_over_basis(MapStore& map, const fs::path& other, const MapStore::Damaged& damaged) {
  const std::optional<std::string> basis = basis_of(other, map.identity());
  const auto own = map.value(kBasisValue);
  if (own == basis) return;
  const auto refuse = [&](const StoredPlace&) -> std::vector<float> {
    throw InputError("the map has places, which are not described with the basis of " +
                     shown_name(other));
  };
  if (own || map.size() > 0) refuse({});
  // As a new revision: others who have opened the map learn no basis of their own any more.
  const int64_t revision = map.read(
                                  0, [](StoredPlace&&) {}, damaged)
                               .revision;
  if (!map.replace_descriptors(refuse, {{kBasisValue, *basis}}, revision) &&
      map.value(kBasisValue) != basis)  // another robot took it over meanwhile
    refuse({});
}

namespace {

struct Source {
  fs::path file;
  std::unique_ptr<MapStore> map;
};

/// One scan in two maps has the same frame and numbers.
int64_t content_of(const StoredPlace& place) {
  Checksum sum;
  sum.bytes(place.drive).number(place.frame);
  for (const std::vector<float>* numbers : {&place.descriptor, &place.feature})
    sum.bytes({reinterpret_cast<const char*>(numbers->data()), numbers->size() * sizeof(float)});
  return sum.value();
}

std::vector<Source> open_sources(std::span<const fs::path> maps) {
  if (maps.empty()) throw UsageError("merging maps: expected at least one, found none");
  std::vector<Source> sources;
  for (const fs::path& map : maps) {
    for (const Source& source : sources)
      if (source.file == map ||
          (!is_on_a_server(map.string()) && !is_on_a_server(source.file.string()) &&
           fs::exists(map) && fs::equivalent(source.file, map)))
        throw UsageError("merging maps: ", shown_name(map), " is given twice");
    sources.push_back({map, open_map(map, MapAccess::kRead,
                                     sources.empty() ? nullptr : &sources[0].map->identity())});
    if (sources.back().map->value(kBasisValue) != sources[0].map->value(kBasisValue))
      throw InputError(
          shown_name(map), ": its places are described with another basis than those of ",
          shown_name(maps[0]), "; a map can only take over another's basis when it is new");
  }
  return sources;
}

/// Drives of one name in several maps are different recordings unless the maps share a scan of it.
/// All but the first then become MAP/DRIVE.
class DriveNames {
 public:
  explicit DriveNames(std::span<const Source> sources) {
    std::map<std::string, int> count;
    for (const Source& source : sources) {
      const bool on_a_server = is_on_a_server(source.file.string());
      const std::string name = on_a_server ? "server" : source.file.stem().string();
      const int number = ++count[name];
      labels_[&source] = number == 1 ? name : str(name, "-", number);
    }
  }
  void add(const Source& source, const std::string& drive) {
    const auto [found, is_new] = owners_.emplace(drive, &source);
    if (!is_new && found->second != &source) renamed_.insert({&source, drive});
  }
  void add_shared(const std::string& drive) { shared_.insert(drive); }
  std::string name_of(const Source& source, const std::string& drive) const {
    if (!renamed_.contains({&source, drive}) || shared_.contains(drive)) return drive;
    const std::string& label = labels_.at(&source);
    return drive.empty() ? label : label + "/" + drive;
  }
  void tell(const MapStore::Damaged& report) const {
    for (const auto& [source, drive] : renamed_)
      if (!shared_.contains(drive))
        report(str(shown_name(source->file), ": drive '", drive, "' becomes '",
                   name_of(*source, drive), "': another map has a recording of that name"));
  }

 private:
  std::map<const Source*, std::string> labels_;
  std::map<std::string, const Source*> owners_;
  std::set<std::pair<const Source*, std::string>> renamed_;
  std::set<std::string> shared_;
};

}  // namespace

int64_t merge_maps(std::span<const fs::path> maps, const fs::path& file,
                   const MapStore::Damaged& report) {
  const std::vector<Source> sources = open_sources(maps);
  DriveNames names(sources);
  std::set<int64_t> seen;
  for (const Source& source : sources)
    source.map->read(
        0,
        [&](StoredPlace&& place) {
          if (seen.insert(content_of(place)).second)
            names.add(source, place.drive);
          else
            names.add_shared(place.drive);
        },
        report);
  names.tell(report);

  const MapStore& first = *sources[0].map;
  const auto merged = open_map(file, MapAccess::kNew, &first.identity(), first.number_format());
  for (const char* name : {kBasisValue, kCalibrationValue, kThresholdValue}) {
    const auto value = first.value(name);
    const bool is_common = std::ranges::all_of(
        sources, [&](const Source& source) { return source.map->value(name) == value; });
    if (!is_common)
      report(str("the maps differ in their ", name, ": the merged map has none of its own"));
    else if (value)
      merged->set_value(name, *value);
  }
  for (const Source& source : sources) {
    std::vector<StoredPlace> places;
    const auto clouds = open_map(source.file, MapAccess::kRead);  // asked while the other reads
    int64_t known = 0;
    source.map->read(
        0,
        [&](StoredPlace&& place) {
          if (seen.erase(content_of(place)) == 0) return void(++known);
          place.drive = names.name_of(source, place.drive);
          try {
            place.cloud = clouds->cloud(place.id);
          } catch (const InputError& error) {
            report(error.what());
          }
          places.push_back(std::move(place));
          if (places.size() == kAtOnce) merged->add(std::exchange(places, {}));
        },
        [](const std::string&) {});  // reported before
    merged->add(places);
    if (known > 0)
      report(str(shown_name(source.file), ": ", known, " of its places are in the maps before it"));
  }
  return merged->size();
}

}  // namespace revisit::pipeline
