#include "sqlite_map.h"

#include "checksum.h"
#include "damaged_places.h"
#include "place_row.h"
#include "removed_places.h"
#include "revisit/base/error.h"

namespace revisit::pipeline {
namespace {

using sqlite::Locking;
using sqlite::Statement;
using sqlite::Transaction;

constexpr const char* kSelectValue = "SELECT name, bytes, checksum FROM value WHERE id = ?";

int64_t value_checksum(int64_t id, std::string_view name, std::string_view bytes) {
  return Checksum().number(id).bytes(name).bytes(bytes).value();
}

/// Value `id`; what is wrong with it is in `damage`, or that is "".
std::pair<std::string, std::string> select_value(sqlite::Connection& connection, Statement& select,
                                                 int64_t id, std::string& damage) {
  const int code = select.reset().bind(1, id).try_step();
  if (code != SQLITE_ROW && code != SQLITE_DONE && !sqlite::is_damage(code)) connection.fail(code);
  damage = code == SQLITE_ROW ? "" : code == SQLITE_DONE ? "not found" : sqlite3_errstr(code);
  if (!damage.empty()) return {};
  if (select.type(0) == SQLITE_TEXT && select.type(1) == SQLITE_BLOB) {
    std::pair<std::string, std::string> value(select.bytes(0), select.bytes(1));
    if (value_checksum(id, value.first, value.second) == select.integer(2)) return value;
  }
  damage = "its checksum is wrong";
  return {};
}

}  // namespace

SqliteMap::SqliteMap(std::unique_ptr<WriterLock> lock,
                     std::unique_ptr<sqlite::Connection> connection,
                     std::vector<std::string> losses)
    : lock_(std::move(lock)),
      connection_(std::move(connection)),
      head_(read_head(*connection_)),
      losses_(std::move(losses)) {}

SqliteMap::~SqliteMap() {
  // Then the one file has all, also when readers keep the log.
  if (lock_ != nullptr)
    sqlite3_wal_checkpoint_v2(connection_->handle(), nullptr, SQLITE_CHECKPOINT_PASSIVE, nullptr,
                              nullptr);
}

void SqliteMap::must_be_writer() const {
  if (lock_ == nullptr)
    throw UsageError(str(connection_->name(), ": this map was opened for reading (MapAccess)"));
}

int64_t SqliteMap::size() const {
  const Transaction moment(*connection_, Locking::kReads);
  const int64_t there = read_counts(*connection_).places;
  return there - count_removed(*connection_, there);
}

std::optional<std::string> SqliteMap::value(const std::string& name) const {
  const Transaction moment(*connection_, Locking::kReads);
  Statement select(*connection_, kSelectValue);
  std::string damages;
  const int64_t n = read_counts(*connection_).values;
  for (int64_t id = 1; id <= n; ++id) {
    std::string damage;
    auto [found, bytes] = select_value(*connection_, select, id, damage);
    if (!damage.empty())
      damages += str("; value ", id, ": ", damage);
    else if (found == name)
      return std::move(bytes);
  }
  if (damages.empty()) return std::nullopt;
  throw InputError(str(connection_->name(), ": the value '", name,
                       "' is not among those that can be read, and may be a damaged one", damages));
}

void SqliteMap::put_value(const std::string& name, const std::string& bytes) {
  if (name.size() + bytes.size() > sqlite::kMostBytes - 1000)
    throw UsageError(
        str("value '", name, "' has ", bytes.size(), " bytes, more than the limit of 256 MB"));
  Counts counts = read_counts(*connection_);
  int64_t id = counts.values + 1;
  {
    Statement select(*connection_, kSelectValue);
    for (int64_t other = 1; other <= counts.values; ++other) {
      std::string damage;
      if (select_value(*connection_, select, other, damage).first == name && damage.empty())
        id = other;
      if (!damage.empty())
        throw InputError(str(connection_->name(), ": value ", other, " is damaged, which may be '",
                             name, "': ", damage));
    }
  }
  Statement(*connection_,
            "INSERT OR REPLACE INTO value (id, name, bytes, checksum) VALUES (?, ?, ?, ?)")
      .bind(1, id)
      .bind(2, std::string_view(name))
      .bind_blob(3, bytes)
      .bind(4, value_checksum(id, name, bytes))
      .step();
  if (id > counts.values) {
    counts.values = id;
    write_counts(*connection_, counts);
  }
}

void SqliteMap::set_value(const std::string& name, const std::string& bytes) {
  must_be_writer();
  Transaction step(*connection_, Locking::kWrites);
  put_value(name, bytes);
  step.commit();
}

std::vector<int64_t> SqliteMap::add(std::span<const StoredPlace> places,
                                    std::optional<int64_t> expected, Claim* claim) {
  must_be_writer();
  std::vector<int64_t> ids;
  if (claim != nullptr) check_places_of(*claim, places);
  if (places.empty()) {
    if (claim != nullptr) claims_.end(*claim, places);
    return ids;
  }
  Transaction step(*connection_, Locking::kWrites);
  Counts counts = read_counts(*connection_);
  const int64_t revision = read_head(*connection_).revision;
  if (expected && *expected != revision) return ids;
  {
    Statement insert(*connection_, kInsertPlace);
    for (const StoredPlace& place : places) {
      const PlaceRow row = place_row(place, head_.format, ids.size() + 1);
      ids.push_back(++counts.places);
      insert_place(insert, ids.back(), place, row, revision);
    }
  }
  write_counts(*connection_, counts);
  step.commit();
  if (claim != nullptr) claims_.end(*claim, places);
  return ids;
}

void SqliteMap::expect(const std::string& drive, std::span<const int64_t> frames) {
  must_be_writer();
  check_drive(drive);
  std::set<int64_t> there;
  const Transaction moment(*connection_, Locking::kReads);
  Statement select(*connection_, "SELECT frame FROM place WHERE drive = ?");
  select.bind(1, std::string_view(drive));
  int code = SQLITE_OK;
  while ((code = select.try_step()) == SQLITE_ROW) there.insert(select.integer(0));
  if (code != SQLITE_DONE) connection_->fail(code);
  claims_.expect(drive, frames, there);
}

std::unique_ptr<Claim> SqliteMap::claim(const std::string& drive, int64_t most) {
  must_be_writer();
  return claims_.claim(drive, most);
}

MapPosition SqliteMap::read(int64_t after, const Take& take, const Damaged& damaged) const {
  const auto tell_once = [&](const std::string& what) {
    if (told_.insert(what).second) damaged(what);
  };
  const std::string& file = connection_->name();
  const Transaction moment(*connection_, Locking::kReads);
  for (const std::string& loss : losses_) tell_once(loss);
  std::string head_damage;
  const MapHead head = read_head(*connection_, &head_damage);
  if (!head_damage.empty())
    tell_once(
        str(file, ": one of two copies of what the map was made with is damaged: ", head_damage));
  const Counts counts = read_counts(*connection_);
  if (!counts.damage.empty())
    tell_once(str(file, ": the number of places is damaged: ", counts.damage, "; ", counts.places,
                  " is the last that was found"));
  Statement select(*connection_, kSelectPlace);
  DamagedPlaces places(file, damaged);
  const int64_t n_removed = last_removal(*connection_);
  std::optional<std::set<int64_t>>
      removed;  // read from the beginning on, and when a row is missing
  const auto was_removed = [&](int64_t id) {
    if (!removed) {
      const RemovedPlaces found = read_removed(*connection_, 0);
      removed.emplace(found.ids.begin(), found.ids.end());
      if (const std::string what = damage_of(found, counts.places); !what.empty())
        tell_once(str(file, ": the list of removed places is damaged: ", what));
    }
    return removed->contains(id);
  };
  const bool looks_at_all = after <= 0 && n_removed > 0;
  // One by one: a damaged page in the middle hides no other.
  for (int64_t id = std::max<int64_t>(after, 0) + 1; id <= counts.places; ++id) {
    StoredPlace place;
    const std::string damage =
        select_place(*connection_, select, id, head.format, head.revision, place);
    if (!damage.empty() && !(damage == kRowNotFound && was_removed(id))) {
      places.add(id, id, damage);
      continue;
    }
    places.flush();  // a caller that throws has heard of it
    if (looks_at_all && damage.empty() && was_removed(id))
      tell_once(str(file, ": place ", id, " is there, and in the list of removed places"));
    if (damage.empty()) take(std::move(place));
  }
  places.flush();
  return {.last = counts.places, .revision = head.revision, .removed = n_removed};
}

bool SqliteMap::replace_descriptors(
    const std::function<std::vector<float>(const StoredPlace&)>& descriptor_of,
    const std::map<std::string, std::string>& values, int64_t revision) {
  must_be_writer();
  Transaction step(*connection_, Locking::kWrites);
  MapHead head = read_head(*connection_);
  if (head.revision != revision) return false;
  const int64_t places = read_counts(*connection_).places;
  {
    Statement select(*connection_, kSelectPlace);
    Statement replace(*connection_, kReplacePlace);
    for (int64_t id = 1; id <= places; ++id) {
      StoredPlace place;
      if (!select_place(*connection_, select, id, head.format, head.revision, place).empty())
        continue;
      select.reset();
      place.descriptor = descriptor_of(place);
      place.feature.clear();
      insert_place(replace, id, place, place_row(place, head.format, id), head.revision + 1);
    }
  }
  ++head.revision;
  write_head(*connection_, head);
  for (const auto& [name, bytes] : values) put_value(name, bytes);
  step.commit();
  return true;
}

int64_t SqliteMap::remove(std::span<const int64_t> ids) {
  must_be_writer();
  Transaction step(*connection_, Locking::kWrites);
  std::set<int64_t> to_remove = ids_to_remove(ids, read_counts(*connection_).places);
  for (const int64_t id : read_removed(*connection_, 0).ids) to_remove.erase(id);
  if (to_remove.empty()) return 0;
  {
    Statement remove(*connection_, "DELETE FROM place WHERE id = ?");
    for (const int64_t id : to_remove) remove.reset().bind(1, id).step();
  }
  write_removed(*connection_, std::vector<int64_t>(to_remove.begin(), to_remove.end()));
  step.commit();
  return static_cast<int64_t>(to_remove.size());
}

std::vector<int64_t> SqliteMap::removed(int64_t after) const {
  const Transaction moment(*connection_, Locking::kReads);
  return read_removed(*connection_, after).ids;
}

std::vector<std::string> SqliteMap::check() const {
  std::vector<std::string> wrong;
  const auto add = [&](const std::string& what) { wrong.push_back(what); };
  read(
      0, [](StoredPlace&&) {}, add);

  const std::string& file = connection_->name();
  const Transaction moment(*connection_, Locking::kReads);
  const int64_t values = read_counts(*connection_).values;
  Statement select(*connection_, kSelectValue);
  for (int64_t id = 1; id <= values; ++id) {
    std::string damage;
    select_value(*connection_, select, id, damage);
    if (!damage.empty()) add(str(file, ": value ", id, " is damaged: ", damage));
  }
  // What is not our content: free pages, the trees' inner pages.
  Statement integrity(*connection_, "PRAGMA integrity_check(20)");
  int code = SQLITE_OK;
  while ((code = integrity.try_step()) == SQLITE_ROW)
    if (integrity.bytes(0) != "ok") add(str(file, ": ", integrity.bytes(0)));
  if (code != SQLITE_DONE) {
    if (!sqlite::is_damage(code)) connection_->fail(code);
    add(str(file, ": ", sqlite3_errstr(code)));
  }
  return wrong;
}

}  // namespace revisit::pipeline
