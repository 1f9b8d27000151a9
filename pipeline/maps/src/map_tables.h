#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "map_format.h"
#include "sql_driver.h"

/// Statements on the tables of a map. They must run in a transaction, and throw InputError for
/// corrupt rows.
namespace revisit {

/// One per table, in this order.
std::vector<std::string> table_definitions(const SqlDialect& dialect);
/// Creates the tables. Throws UsageError as text_of().
void create_tables(SqlDriver& driver, const MapHeader& header);

MapHeader read_header(SqlDriver& driver);
void write_header(SqlDriver& driver, const MapHeader& header);

Counts read_counts(SqlDriver& driver);
/// Before a change: locks the counts until the commit. Ids are then assigned in the order of
/// commits: with a sequence, a reader that has seen id 7 could miss a 6 that is committed later.
Counts lock_counts(SqlDriver& driver);
void write_counts(SqlDriver& driver, const Counts& counts);

/// `sql`: kInsertEntry or kReplaceEntry.
void write_entry(SqlDriver& driver, const char* sql, int64_t id, EntryRow row, int64_t revision);
inline constexpr const char* kInsertEntry =
    "INSERT INTO entry (id, drive, frame, time, pose, descriptor, feature, revision, checksum) "
    "VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9)";
inline constexpr const char* kReplaceEntry =
    "UPDATE entry SET drive = $2, frame = $3, time = $4, pose = $5, descriptor = $6, feature = $7, "
    "revision = $8, checksum = $9 WHERE id = $1";
/// Passes entries with ids in (`after`, `last`] to `take` and advances `after`; passes id and
/// problem of each corrupt one to `report`. Returns the number of rows.
int64_t for_each_entry(SqlDriver& driver, const MapHeader& header, int64_t& after, int64_t last,
                       const std::function<void(MapEntry&&)>& take,
                       const std::function<void(int64_t, const std::string&)>& report);
void write_cloud(SqlDriver& driver, int64_t id, const std::string& bytes);
/// Returns "" if there is none.
std::string read_cloud(SqlDriver& driver, int64_t id);

int64_t count_removed(SqlDriver& driver, int64_t after);
/// Ids in the order of removal, without the first `after`.
std::vector<int64_t> read_removed(SqlDriver& driver, int64_t after);
void write_removed(SqlDriver& driver, int64_t entry);

/// Prefix of the names of values that reserve_drive() stores.
inline constexpr const char* kRecordingOf = "recording of ";
/// Also throws if a value was lost.
std::optional<std::string> read_value(SqlDriver& driver, const std::string& name);
/// Call lock_counts() before. Throws UsageError for more than 256 MB.
void write_value(SqlDriver& driver, const std::string& name, const std::string& bytes);
void check_values(SqlDriver& driver);

}  // namespace revisit
