#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "map_file.h"
#include "map_format.h"
#include "revisit/maps/map_store.h"
#include "sqlite.h"

/// Tables of a map in a file. The functions throw InputError for corrupt rows.
namespace revisit {

/// `lock`: null for a reader.
std::unique_ptr<MapStore> make_sqlite_map(std::unique_ptr<WriterLock> lock,
                                          std::unique_ptr<sqlite::Connection> connection);

/// Needs an empty database. Throws UsageError as text_of().
void make_tables(sqlite::Connection& connection, const MapHeader& header);
void check_schema(sqlite::Connection& connection);

MapHeader read_header(sqlite::Connection& connection);
void write_header(sqlite::Connection& connection, const MapHeader& header);
Counts read_counts(sqlite::Connection& connection);
void write_counts(sqlite::Connection& connection, const Counts& counts);

int64_t count_removed(sqlite::Connection& connection, int64_t after);
int64_t last_removal(sqlite::Connection& connection);
/// Ids in the order of removal, without the first `after`.
std::vector<int64_t> read_removed(sqlite::Connection& connection, int64_t after);
void write_removed(sqlite::Connection& connection, std::span<const int64_t> entries);

void write_cloud(sqlite::Connection& connection, int64_t id, const std::string& bytes);
/// Returns "" if there is none.
std::string read_cloud(sqlite::Connection& connection, int64_t id);

/// Executes kInsertEntry or kReplaceEntry.
void write_entry(sqlite::Statement& statement, int64_t id, const MapEntry& entry,
                 const EntryRow& row, int64_t revision);
inline constexpr const char* kInsertEntry =
    "INSERT INTO entry (drive, frame, time, pose, descriptor, feature, revision, checksum, id) "
    "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)";
inline constexpr const char* kReplaceEntry =
    "UPDATE entry SET drive = ?, frame = ?, time = ?, pose = ?, descriptor = ?, feature = ?, "
    "revision = ?, checksum = ? WHERE id = ?";

/// Reads the current row of kSelectEntries; returns "", or the problem of the row.
std::string take_row(sqlite::Statement& select, const MapHeader& header, MapEntry& entry);
inline constexpr const char* kSelectEntries =
    "SELECT id, drive, frame, time, pose, descriptor, feature, revision, checksum FROM entry "
    "WHERE id > ? AND id <= ? ORDER BY id";

}  // namespace revisit
