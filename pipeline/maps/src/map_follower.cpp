#include "map_follower.h"

#include <string>
#include <utility>

namespace revisit {

MapFollower::MapFollower(MapStore& map, const FeatureExtractor& extractor, KnownEntries& entries,
                         Acceptance& acceptance, const MapStore::Warn& warn)
    : map_(map), extractor_(extractor), entries_(entries), acceptance_(acceptance), warn_(warn) {
  load_updates();
}

void MapFollower::load_updates() {
  is_behind_ = true;
  read_new_entries();
  entries_.update();
  if (read_to_.removed > removals_known_) entries_.remove_ids(map_.removed(removals_known_));
  removals_known_ = read_to_.removed;
  is_behind_ = false;
}

void MapFollower::read_new_entries() {
  if (!entries_.is_final()) look_for_projection();
  acceptance_.refresh();
  if (entries_.is_final()) {
    const auto take = [&](MapEntry&& entry) {
      const int64_t id = entry.id;
      take_in(std::move(entry));
      read_to_.last = id;
    };
    read_to_ = map_.read(read_to_.last, take, warn_);
    return;
  }
  std::vector<MapEntry> entries_read;
  const MapState state = map_.read(
      read_to_.last, [&](MapEntry&& entry) { entries_read.push_back(std::move(entry)); }, warn_);
  // Another process may have completed the warm-up meanwhile: then these have no features.
  look_for_projection();
  read_to_ = state;
  for (MapEntry& entry : entries_read) take_in(std::move(entry));
}

void MapFollower::look_for_projection() {
  if (const auto content = map_.value(kProjectionValue))
    entries_.set_projection(extractor_.open_projection(*content));
}

void MapFollower::take_in(MapEntry entry) {
  if (const std::string misfit = entries_.misfit_of(entry); !misfit.empty()) return warn_(misfit);
  std::string().swap(entry.cloud);
  entries_.add(std::move(entry));
}

std::vector<int64_t> MapFollower::add(std::vector<MapEntry> entries, Claim* claim) {
  std::vector<std::vector<float>> features;
  for (MapEntry& entry : entries) features.push_back(std::exchange(entry.feature, {}));
  std::vector<int64_t> ids;
  while (true) {
    const bool is_final = entries_.is_final();
    for (size_t i = 0; i < entries.size(); ++i) {
      entries[i].feature = is_final ? std::vector<float>() : features[i];
      entries[i].descriptor = is_final ? entries_.descriptor_of(features[i]) : features[i];
    }
    ids = claim != nullptr ? claim->add(entries, read_to_.revision)
                           : map_.add(entries, read_to_.revision);
    if (ids.size() == entries.size()) break;
    load_updates();
  }
  if (ids.empty()) return ids;
  if (ids.front() != read_to_.last + 1) {
    load_updates();
    return ids;
  }
  read_to_.last = ids.back();
  for (size_t i = 0; i < ids.size(); ++i) {
    entries[i].id = ids[i];
    take_in(std::move(entries[i]));
  }
  entries_.update();
  return ids;
}

void MapFollower::store_projection() {
  const bool first = map_.replace_descriptors(
      [&](const MapEntry& entry) {
        return entries_.misfit_of(entry).empty() ? entries_.descriptor_of(entry.feature)
                                                 : entry.descriptor;
      },
      {{kProjectionValue, entries_.projection().content}}, read_to_.revision);
  if (!first) return load_updates();
  ++read_to_.revision;
  entries_.end_warm_up();
}

}  // namespace revisit
