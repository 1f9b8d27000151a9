#include "sqlite_tables.h"

#include <array>

#include "revisit/base/error.h"

namespace revisit {
namespace {

using sqlite::Connection;
using sqlite::Statement;

/// Sector size of disks and file systems, so that a transaction writes few bytes.
constexpr int kPageSize = 4096;

constexpr std::array kMapTables{
    "CREATE TABLE map (id INTEGER PRIMARY KEY, fingerprint TEXT, dtype TEXT, revision INTEGER, "
    "checksum INTEGER)",
    "CREATE TABLE counts (id INTEGER PRIMARY KEY, entries INTEGER, \"values\" INTEGER, checksum "
    "INTEGER)",
    "CREATE TABLE value (id INTEGER PRIMARY KEY, name TEXT, bytes BLOB, checksum INTEGER)",
    "CREATE TABLE entry (id INTEGER PRIMARY KEY, drive TEXT, frame INTEGER, time REAL, pose BLOB, "
    "descriptor BLOB, feature BLOB, revision INTEGER, checksum INTEGER)",
    "CREATE TABLE removed (id INTEGER PRIMARY KEY, entry INTEGER, checksum INTEGER)",
    "CREATE TABLE cloud (id INTEGER PRIMARY KEY, bytes BLOB, checksum INTEGER)",
};

}  // namespace

void make_tables(Connection& connection, const MapHeader& header) {
  connection.execute(str("PRAGMA page_size = ", kPageSize));
  connection.execute("PRAGMA auto_vacuum = NONE");
  connection.execute(str("PRAGMA application_id = ", kApplicationId));
  connection.execute(str("PRAGMA user_version = ", kMapVersion));
  for (const char* table : kMapTables) connection.execute(table);
  write_header(connection, header);
  write_counts(connection, {});
}

void check_schema(Connection& connection) {
  const int64_t version = connection.integer("PRAGMA user_version");
  if (version != kMapVersion)
    throw InputError(connection.name(), ": map version ", version, " (expected ", kMapVersion,
                     "); build the map again, or use another revisit");
  // A writer would use other pages as pages of entries.
  if (connection.integer("PRAGMA auto_vacuum") != 0) connection.fail_corrupt("it has auto_vacuum");
  const std::vector<std::string> expected(kMapTables.begin(), kMapTables.end());
  std::vector<std::string> found;
  Statement select(connection, "SELECT sql FROM sqlite_schema ORDER BY rowid");
  while (found.size() <= expected.size() && select.step()) found.emplace_back(select.bytes(0));
  if (found != expected) connection.fail_corrupt("its tables are not those of a map");
}

MapHeader read_header(Connection& connection) {
  Statement select(connection,
                   "SELECT fingerprint, dtype, revision, checksum FROM map WHERE id = 1");
  if (!select.step()) connection.fail_corrupt("its header is missing");
  const std::string fingerprint(select.bytes(0));
  auto header = header_from(fingerprint, select.bytes(1), select.integer(2), select.integer(3));
  if (!header) connection.fail_corrupt("the checksum of its header is wrong");
  return *std::move(header);
}

void write_header(Connection& connection, const MapHeader& header) {
  const std::string text = text_of(header.fingerprint);
  const std::string_view dtype = name_of(header.format);
  Statement(connection,
            "INSERT OR REPLACE INTO map (id, fingerprint, dtype, revision, checksum) VALUES (1, "
            "?, ?, ?, ?)")
      .bind(1, std::string_view(text))
      .bind(2, dtype)
      .bind(3, header.revision)
      .bind(4, header_checksum(text, dtype, header.revision))
      .step();
}

Counts read_counts(Connection& connection) {
  Statement select(connection, "SELECT entries, \"values\", checksum FROM counts WHERE id = 1");
  if (!select.step()) connection.fail_corrupt("the number of its entries is missing");
  const Counts counts{.entries = select.integer(0), .values = select.integer(1)};
  if (checksum_of(counts) != select.integer(2))
    connection.fail_corrupt("the checksum of the number of its entries is wrong");
  // A row takes more than 16 bytes.
  const int64_t most =
      connection.integer("PRAGMA page_count") * connection.integer("PRAGMA page_size") / 16;
  if (counts.entries < 0 || counts.entries > most || counts.values < 0 || counts.values > most)
    connection.fail_corrupt(str("its header claims ", counts.entries, " entries and ",
                                counts.values, " values, more than a file of its size can hold"));
  return counts;
}

void write_counts(Connection& connection, const Counts& counts) {
  Statement replace(connection,
                    "INSERT OR REPLACE INTO counts (id, entries, \"values\", checksum) "
                    "VALUES (1, ?, ?, ?)");
  replace.bind(1, counts.entries).bind(2, counts.values).bind(3, checksum_of(counts)).step();
}

int64_t count_removed(Connection& connection, int64_t after) {
  return connection.integer(str("SELECT count(*) FROM removed WHERE entry > ", after));
}

int64_t last_removal(Connection& connection) {
  return connection.integer("SELECT max(id) FROM removed");
}

std::vector<int64_t> read_removed(Connection& connection, int64_t after) {
  std::vector<int64_t> entries;
  Statement select(connection, "SELECT id, entry, checksum FROM removed WHERE id > ? ORDER BY id");
  select.bind(1, after);
  while (select.step()) {
    entries.push_back(select.integer(1));
    if (removed_checksum(select.integer(0), entries.back()) != select.integer(2))
      connection.fail_corrupt("a checksum in the list of removed entries is wrong");
  }
  return entries;
}

void write_removed(Connection& connection, std::span<const int64_t> entries) {
  Statement insert(connection, "INSERT INTO removed (id, entry, checksum) VALUES (?, ?, ?)");
  for (const int64_t entry : entries) {
    // SQLite computes the id: it fails after the largest number.
    const int64_t id = connection.integer("SELECT ifnull(max(id), 0) + 1 FROM removed");
    insert.reset().bind(1, id).bind(2, entry).bind(3, removed_checksum(id, entry)).step();
  }
}

void write_cloud(Connection& connection, int64_t id, const std::string& bytes) {
  Statement(connection, "INSERT INTO cloud (id, bytes, checksum) VALUES (?, ?, ?)")
      .bind(1, id)
      .bind_blob(2, bytes)
      .bind(3, cloud_checksum(id, bytes))
      .step();
}

std::string read_cloud(Connection& connection, int64_t id) {
  Statement select(connection, "SELECT bytes, checksum FROM cloud WHERE id = ?");
  if (!select.bind(1, id).step()) return "";
  std::string bytes(select.bytes(0));
  if (cloud_checksum(id, bytes) != select.integer(1))
    connection.fail_corrupt(str("the checksum of the points of entry ", id, " is wrong"));
  return bytes;
}

void write_entry(Statement& statement, int64_t id, const MapEntry& entry, const EntryRow& row,
                 int64_t revision) {
  const RowView view = view_of(entry, row, revision);
  statement.reset().bind(1, view.drive).bind(2, view.frame);
  if (view.time)
    statement.bind(3, *view.time);
  else
    statement.bind_null(3);
  const auto bind_or_null = [&](int parameter, const std::string& bytes) {
    if (bytes.empty())
      statement.bind_null(parameter);
    else
      statement.bind_blob(parameter, bytes);
  };
  bind_or_null(4, row.pose);
  statement.bind_blob(5, row.descriptor);
  bind_or_null(6, row.feature);
  statement.bind(7, revision).bind(8, checksum_of(id, view)).bind(9, id).step();
}

std::string take_row(Statement& select, const MapHeader& header, MapEntry& entry) {
  RowView row{.drive = select.bytes(1),
              .frame = select.integer(2),
              .pose = select.bytes(4),
              .descriptor = select.bytes(5),
              .feature = select.bytes(6),
              .revision = select.integer(7),
              .checksum = select.integer(8)};
  if (select.type(3) != SQLITE_NULL) row.time = select.real(3);
  return take_row(select.integer(0), row, header, entry);
}

}  // namespace revisit
