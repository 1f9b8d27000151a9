#pragma once

#include <algorithm>
#include <cstdint>
#include <pqxx/pqxx>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "place_row.h"
#include "removed_places.h"
#include "revisit/base/error.h"
#include "schema.h"

/// The tables of a map on a server, and the statements about them. All happen within a transaction
/// of the caller's and throw what libpqxx throws.
namespace revisit::pipeline::postgres {

/// Table `place`: `call` is a random number of the call that added the place.
inline constexpr const char* kTables =
    "CREATE TABLE map (id INTEGER PRIMARY KEY, version INTEGER NOT NULL, identity TEXT NOT NULL, "
    "bytes_per_number INTEGER NOT NULL, revision BIGINT NOT NULL, checksum BIGINT NOT NULL);"
    "CREATE TABLE counts (id INTEGER PRIMARY KEY, places BIGINT NOT NULL, checksum BIGINT NOT "
    "NULL);"
    "CREATE TABLE value (name TEXT PRIMARY KEY, bytes BYTEA NOT NULL, checksum BIGINT NOT NULL);"
    "CREATE TABLE place (id BIGINT PRIMARY KEY, drive TEXT NOT NULL, frame BIGINT NOT NULL, time "
    "FLOAT8, pose BYTEA, descriptor BYTEA NOT NULL, feature BYTEA, revision BIGINT NOT NULL, "
    "checksum BIGINT NOT NULL, call BIGINT NOT NULL)";

/// What the map expects (MapStore::expect()). `place`: the id of the frame's place, 0 for one that
/// was left out, NULL while it is expected. Maps of before have no such table.
inline constexpr const char* kTableOfExpected =
    "CREATE TABLE IF NOT EXISTS expected (drive TEXT NOT NULL, frame BIGINT NOT NULL, place "
    "BIGINT, why_not TEXT, PRIMARY KEY (drive, frame))";

/// The places that were removed, in the order of removal. A map has it from the start or from the
/// first removal on, which raises the version of the map.
inline constexpr const char* kTableOfRemoved =
    "CREATE TABLE IF NOT EXISTS removed (id BIGINT PRIMARY KEY, place BIGINT NOT NULL UNIQUE, "
    "checksum BIGINT NOT NULL)";

inline constexpr int kPlacesAtOnce = 256;  // in memory

pqxx::binarystring bytes_of(std::string_view text);
std::string bytes_in(const pqxx::field& field);
int64_t value_checksum(std::string_view name, std::string_view bytes);

/// Throws InputError, which begins with `name`.
MapHead read_head(pqxx::transaction_base& step, const std::string& name);
void write_head(pqxx::transaction_base& step, const MapHead& head);

/// Whether the schema of this map has a table.
bool has_table(pqxx::transaction_base& step, const std::string& map, const std::string& table);

/// How many places there are; `damage`: when that had to be taken from the places, why. Throws
/// InputError, which begins with `name`, for more than any map has.
int64_t read_places(pqxx::transaction_base& step, const std::string& name, const char* lock,
                    std::string* damage = nullptr);
void write_places(pqxx::transaction_base& step, int64_t places);
/// Whoever adds or changes places locks this row until the commit. So ids are given in the order of
/// the commits: a reader who has seen id 7 never meets a 6 that was committed later, as it would
/// with a sequence. It also waits for a lost connection's own commit to end.
int64_t lock_places(pqxx::transaction_base& step, const std::string& name);

/// How many of the places 1 to `there` were removed, 0 from a map without the table.
int64_t count_removed(pqxx::transaction_base& step, int64_t there);
/// The last id in the table `removed`. Ids are missing where a damaged row was replaced.
int64_t last_removal(pqxx::transaction_base& step);
/// damage_of(), and whether one of these places is there; "" when nothing is wrong.
std::string damage_of_removed(pqxx::transaction_base& step, int64_t there);
/// The places of the rows of `removed` that `where` chooses, in the order of removal.
RemovedPlaces read_removed(pqxx::transaction_base& step, const std::string& where);
/// Removes places that are there or lost, and notes it.
void remove_places(pqxx::transaction_base& step, const std::set<int64_t>& places);

/// `sql`: kInsertPlaceAt or kReplacePlaceAt.
void write_place(pqxx::transaction_base& step, const char* sql, int64_t id,
                 const StoredPlace& place, const PlaceRow& row, int64_t revision, int64_t call);
inline constexpr const char* kInsertPlaceAt =
    "INSERT INTO place VALUES ($1, $2, $3, nullif($4, '')::float8, nullif($5::bytea, ''), "
    "$6::bytea, nullif($7::bytea, ''), $8, $9, $10)";
/// With the same parameters, for a place that is there.
inline constexpr const char* kReplacePlaceAt =
    "UPDATE place SET drive = $2, frame = $3, time = nullif($4, '')::float8, pose = "
    "nullif($5::bytea, ''), descriptor = $6::bytea, feature = nullif($7::bytea, ''), revision = "
    "$8, checksum = $9, call = $10 WHERE id = $1";

/// Hands over the places above `last`, up to `places`, and moves `last`. damaged(first, last,
/// reason): what a stranger's map says that it has may be far more than its rows.
template <class Take, class Damage>
void select_places(pqxx::transaction_base& step, const MapHead& head, int64_t places, int64_t& last,
                   const Take& take, const Damage& damaged) {
  while (last < places) {
    const pqxx::result rows = step.exec_params(
        "SELECT id, drive, frame, time, pose, descriptor, feature, revision, checksum, call FROM "
        "place WHERE id > $1 AND id <= $2 ORDER BY id LIMIT $3",
        last, places, kPlacesAtOnce);
    const int64_t end = rows.size() < kPlacesAtOnce ? places : rows.back()[0].as<int64_t>();
    std::vector<int64_t> removed;
    if (static_cast<int64_t>(rows.size()) < end - last)
      removed = read_removed(step, str("place > ", last, " AND place <= ", end)).ids;
    std::ranges::sort(removed);
    const auto miss_those_before = [&](int64_t id) {
      auto next = std::ranges::upper_bound(removed, last);
      while (last + 1 < id) {
        const int64_t stop = next == removed.end() ? id : std::min(id, *next++);
        if (last + 1 < stop) damaged(last + 1, stop - 1, kRowNotFound);
        last = std::min(stop, id - 1);
      }
    };
    for (const pqxx::row& found : rows) {
      const auto id = found[0].as<int64_t>();
      miss_those_before(id);
      last = id;
      const std::string drive = found[1].as<std::string>(), pose = bytes_in(found[4]),
                        descriptor = bytes_in(found[5]), feature = bytes_in(found[6]);
      RowView row{.drive = drive,
                  .frame = found[2].as<int64_t>(),
                  .pose = pose,
                  .descriptor = descriptor,
                  .feature = feature,
                  .revision = found[7].as<int64_t>(),
                  .checksum = found[8].as<int64_t>()};
      if (!found[3].is_null()) row.time = found[3].as<double>();
      StoredPlace place;
      const std::string damage = take_row(id, row, head.format, head.revision, place);
      if (damage.empty())
        take(std::move(place), found[9].as<int64_t>());
      else
        damaged(id, id, damage);
    }
    miss_those_before(end + 1);
  }
}

}  // namespace revisit::pipeline::postgres
