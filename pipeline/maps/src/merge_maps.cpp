#include <utility>

#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/maps/map_store.h"

namespace revisit::pipeline {
namespace {

namespace fs = std::filesystem;

constexpr size_t kAtOnce = 1000;  // places a step

}  // namespace

void take_over_basis(MapStore& map, const fs::path& other, const MapStore::Damaged& damaged) {
  const auto theirs = open_map(other, MapAccess::kRead, &map.identity());
  const auto basis = theirs->value(kBasisValue);
  if (!basis)
    throw InputError(shown_name(other), ": its basis is not learnt yet: it has ", theirs->size(),
                     " places, too few");
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

int64_t merge_maps(std::span<const fs::path> maps, const fs::path& file,
                   const MapStore::Damaged& damaged) {
  if (maps.empty()) throw UsageError("merging maps: expected at least one, found none");
  std::vector<std::unique_ptr<MapStore>> sources;
  for (const fs::path& map : maps) {
    sources.push_back(
        open_map(map, MapAccess::kRead, sources.empty() ? nullptr : &sources.front()->identity()));
    if (sources.back()->value(kBasisValue) != sources.front()->value(kBasisValue))
      throw InputError(shown_name(map),
                       ": its places are described with another basis than those "
                       "of ",
                       shown_name(maps[0]),
                       "; a map can only take over another's basis when it is new");
  }
  const auto merged = open_map(file, MapAccess::kNew, &sources.front()->identity(),
                               sources.front()->number_format());
  if (const auto basis = sources.front()->value(kBasisValue))
    merged->set_value(kBasisValue, *basis);
  for (const auto& source : sources) {
    std::vector<StoredPlace> places;
    const auto add = [&](StoredPlace&& place) {
      places.push_back(std::move(place));
      if (places.size() == kAtOnce) merged->add(std::exchange(places, {}));
    };
    source->read(0, add, damaged);
    merged->add(places);
  }
  return merged->size();
}

}  // namespace revisit::pipeline
