#pragma once

#include <cstdint>
#include <pqxx/pqxx>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "place_row.h"
#include "revisit/base/error.h"
#include "schema.h"

/// The functions run in a transaction of the caller and throw what libpqxx throws.
namespace revisit::postgres {

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

/// Pending frames of the map (WorkQueue::enqueue()). `place` is the id of the frame's entry, 0 if
/// the frame was skipped, NULL while it is pending. Older maps have no such table.
inline constexpr const char* kTableOfExpected =
    "CREATE TABLE IF NOT EXISTS expected (drive TEXT NOT NULL, frame BIGINT NOT NULL, place "
    "BIGINT, why_not TEXT, PRIMARY KEY (drive, frame))";

/// Created with the map or by its first removal, which raises the version of the map.
inline constexpr const char* kTableOfRemoved =
    "CREATE TABLE IF NOT EXISTS removed (id BIGINT PRIMARY KEY, place BIGINT NOT NULL UNIQUE, "
    "checksum BIGINT NOT NULL)";

inline constexpr const char* kTableOfClouds =
    "CREATE TABLE IF NOT EXISTS cloud (id BIGINT PRIMARY KEY, bytes BYTEA NOT NULL, checksum "
    "BIGINT NOT NULL)";

inline constexpr int kPlacesAtOnce = 256;

pqxx::binarystring bytes_of(std::string_view text);
std::string bytes_in(const pqxx::field& field);
int64_t value_checksum(std::string_view name, std::string_view bytes);

/// Throws InputError with the prefix `name`.
MapHead read_head(pqxx::transaction_base& step, const std::string& name);
void write_head(pqxx::transaction_base& step, const MapHead& head);

bool has_table(pqxx::transaction_base& step, const std::string& map, const std::string& table);

void write_places(pqxx::transaction_base& step, int64_t places);
/// Number of entries ever added; `lock` is appended to the statement. Throws InputError.
int64_t read_places(pqxx::transaction_base& step, const std::string& name, const char* lock = "");
/// Locks the row of read_places() until the commit; required before adding or changing entries. Ids
/// are then assigned in the order of commits: with a sequence, a reader that has seen id 7 could
/// miss a 6 that is committed later. Also waits until a commit of a lost connection has ended.
int64_t lock_places(pqxx::transaction_base& step, const std::string& name);

/// 0 for a map without the table.
int64_t count_removed(pqxx::transaction_base& step, int64_t after);
int64_t last_removal(pqxx::transaction_base& step);
/// Ids in the order of removal, without the first `after`. Throws InputError.
std::vector<int64_t> read_removed(pqxx::transaction_base& step, const std::string& name,
                                  int64_t after);
/// Removes existing or missing entries and records the removal.
void remove_places(pqxx::transaction_base& step, const std::set<int64_t>& places);

struct NewPlaces {
  std::span<const StoredPlace> places;
  std::vector<PlaceRow> rows;
  int64_t call;
  /// Throws UsageError for values that cannot be stored.
  NewPlaces(std::span<const StoredPlace> of, DescriptorType format);
};
/// `there`: result of lock_places(). Returns the first id.
int64_t insert_places(pqxx::transaction_base& step, const NewPlaces& all, int64_t there,
                      const MapHead& head);

void write_place(pqxx::transaction_base& step, const char* sql, int64_t id,
                 const StoredPlace& place, const PlaceRow& row, int64_t revision, int64_t call);
inline constexpr const char* kInsertPlaceAt =
    "INSERT INTO place VALUES ($1, $2, $3, nullif($4, '')::float8, nullif($5::bytea, ''), "
    "$6::bytea, nullif($7::bytea, ''), $8, $9, $10)";
inline constexpr const char* kReplacePlaceAt =
    "UPDATE place SET drive = $2, frame = $3, time = nullif($4, '')::float8, pose = "
    "nullif($5::bytea, ''), descriptor = $6::bytea, feature = nullif($7::bytea, ''), revision = "
    "$8, checksum = $9, call = $10 WHERE id = $1";

/// Passes entries with ids in (`last`, `places`] to `take` and advances `last`; passes id and
/// problem of each corrupt one to `warn`. Returns the number of rows.
template <class Take, class Defect>
int64_t select_places(pqxx::transaction_base& step, const MapHead& head, int64_t places,
                      int64_t& last, const Take& take, const Defect& warn) {
  int64_t n = 0;
  while (last < places) {
    const pqxx::result rows = step.exec_params(
        "SELECT id, drive, frame, time, pose, descriptor, feature, revision, checksum, call FROM "
        "place WHERE id > $1 AND id <= $2 ORDER BY id LIMIT $3",
        last, places, kPlacesAtOnce);
    for (const pqxx::row& found : rows) {
      last = found[0].as<int64_t>();
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
      const std::string defect = take_row(last, row, head.format, head.revision, place);
      if (defect.empty())
        take(std::move(place), found[9].as<int64_t>());
      else
        warn(last, defect);
    }
    n += static_cast<int64_t>(rows.size());
    if (rows.size() < kPlacesAtOnce) last = places;
  }
  return n;
}

}  // namespace revisit::postgres
