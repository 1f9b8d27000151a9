#include "schema.h"

#include <algorithm>
#include <array>

#include "checksum.h"
#include "identity.h"
#include "revisit/base/error.h"

namespace revisit::pipeline {
namespace {

using sqlite::Connection;
using sqlite::Statement;

struct Table {
  const char* name;
  const char* sql;
};

constexpr std::array<Table, 5> kMapTables{{
    {"map",
     "CREATE TABLE map (id INTEGER PRIMARY KEY, identity TEXT, bytes_per_number INTEGER, revision "
     "INTEGER, checksum INTEGER)"},
    {"map_copy",
     "CREATE TABLE map_copy (id INTEGER PRIMARY KEY, identity TEXT, bytes_per_number INTEGER, "
     "revision INTEGER, checksum INTEGER)"},
    {"counts",
     "CREATE TABLE counts (id INTEGER PRIMARY KEY, places INTEGER, \"values\" INTEGER, checksum "
     "INTEGER)"},
    {"value",
     "CREATE TABLE value (id INTEGER PRIMARY KEY, name TEXT, bytes BLOB, checksum INTEGER)"},
    {"place",
     "CREATE TABLE place (id INTEGER PRIMARY KEY, drive TEXT, frame INTEGER, time REAL, pose BLOB, "
     "descriptor BLOB, feature BLOB, revision INTEGER, checksum INTEGER)"},
}};
constexpr Table kRemovedTable{
    // the last, from the first removal on
    "removed", "CREATE TABLE removed (id INTEGER PRIMARY KEY, place INTEGER, checksum INTEGER)"};
constexpr std::array<const char*, 2> kHeads{"map", "map_copy"};

/// "", or what is wrong with the head in `table`.
std::string read_head_of(Connection& connection, const char* table, MapHead& head) {
  Statement select(connection, str("SELECT identity, bytes_per_number, revision, checksum FROM ",
                                   table, " WHERE id = 1"));
  const int code = select.try_step();
  if (code == SQLITE_DONE) return "not found";
  if (code != SQLITE_ROW) {
    if (!sqlite::is_damage(code)) connection.fail(code);
    return sqlite3_errstr(code);
  }
  const std::string text(select.type(0) == SQLITE_TEXT ? select.bytes(0) : "");
  const int64_t bytes_per_number = select.integer(1);
  if (head_checksum(text, bytes_per_number, select.integer(2)) != select.integer(3) ||
      (bytes_per_number != 2 && bytes_per_number != 4))
    return "its checksum is wrong";
  head = {.identity = identity_from(text),
          .format = bytes_per_number == 2 ? NumberFormat::kFloat16 : NumberFormat::kFloat32,
          .revision = select.integer(2)};
  return "";
}

/// The largest number in a column, as far as SQLite finds its way.
int64_t largest(Connection& connection, const char* column, const char* table) {
  return connection.integer(str("SELECT max(", column, ") FROM ", table));
}

}  // namespace

int64_t head_checksum(std::string_view identity, int64_t bytes_per_number, int64_t revision) {
  return Checksum().bytes(identity).number(bytes_per_number).number(revision).value();
}

int64_t checksum_of(const Counts& counts) {
  return Checksum().number(counts.places).number(counts.values).value();
}

void make_map(Connection& connection, const MapHead& head) {
  text_of(head.identity);  // refuses before there is a file
  connection.execute(str("PRAGMA page_size = ", kPageSize));
  connection.execute("PRAGMA auto_vacuum = NONE");
  sqlite::Transaction step(connection, sqlite::Locking::kWrites);
  connection.execute(str("PRAGMA application_id = ", kApplicationId));
  connection.execute(str("PRAGMA user_version = ", kFirstMapVersion));
  for (const Table& table : kMapTables) connection.execute(table.sql);
  write_head(connection, head);
  write_counts(connection, {});
  step.commit();
}

bool may_have_removed(Connection& connection) {
  return connection.integer("PRAGMA user_version") > kFirstMapVersion;
}

void make_table_of_removed(Connection& connection) {
  if (may_have_removed(connection)) return;
  connection.execute(kRemovedTable.sql);
  connection.execute(str("PRAGMA user_version = ", kMapVersion));
}

void check_schema(Connection& connection) {
  const std::string& name = connection.name();
  const int64_t application = connection.integer("PRAGMA application_id");
  if (application != kApplicationId)
    throw InputError(str(name, ": a SQLite database, but not a map (application id ", application,
                         ", a map has ", kApplicationId, ")"));
  const int64_t version = connection.integer("PRAGMA user_version");
  if (version > kMapVersion)
    throw InputError(str(name, ": a map of version ", version, ", this program knows version ",
                         kMapVersion, "; use a later revisit"));
  const std::string damaged = str(name, ": the head of this map is damaged: ");
  const std::string remedy = "; go back to a copy of it, or make it again";
  const auto must_be = [&](const std::string& what, const std::string& expected,
                           const std::string& found) {
    if (expected != found)
      throw InputError(str(damaged, what, " is '", found, "', not '", expected, "'", remedy));
  };
  must_be("its version", str(std::max<int64_t>(version, kFirstMapVersion)), str(version));
  must_be("the page size", str(kPageSize), str(connection.integer("PRAGMA page_size")));
  must_be("auto_vacuum", "0", str(connection.integer("PRAGMA auto_vacuum")));
  must_be("the encoding", "UTF-8", connection.text("PRAGMA encoding"));
  Statement select(connection, "SELECT name, sql FROM sqlite_schema ORDER BY rowid");
  const auto must_come = [&](const Table& table) {
    if (!select.step()) throw InputError(str(damaged, "no table '", table.name, "'", remedy));
    must_be("a table's name", table.name, std::string(select.bytes(0)));
    must_be(str("the table '", table.name, "'"), table.sql, std::string(select.bytes(1)));
  };
  for (const Table& table : kMapTables) must_come(table);
  if (version > kFirstMapVersion) must_come(kRemovedTable);
  if (select.step())
    throw InputError(
        str(damaged, "it has '", select.bytes(0), "', which is not part of a map", remedy));
}

MapHead read_head(Connection& connection, std::string* damage) {
  std::optional<MapHead> found;
  std::string reasons;
  for (const char* table : kHeads) {
    MapHead head;
    const std::string reason = read_head_of(connection, table, head);
    if (!reason.empty())
      reasons += str(reasons.empty() ? "" : "; ", "the table '", table, "': ", reason);
    else if (!found)
      found = head;
  }
  if (!found)
    throw InputError(str(connection.name(),
                         ": what this map was made with is damaged, so its descriptors cannot be "
                         "compared: ",
                         reasons, "; make the map again"));
  if (damage != nullptr) *damage = reasons;
  return *found;
}

void write_head(Connection& connection, const MapHead& head) {
  const std::string text = text_of(head.identity);
  const int64_t bytes_per_number = head.format == NumberFormat::kFloat16 ? 2 : 4;
  for (const char* table : kHeads) {
    Statement replace(
        connection,
        str("INSERT OR REPLACE INTO ", table,
            " (id, identity, bytes_per_number, revision, checksum) VALUES (1, ?, ?, ?, ?)"));
    replace.bind(1, std::string_view(text))
        .bind(2, bytes_per_number)
        .bind(3, head.revision)
        .bind(4, head_checksum(text, bytes_per_number, head.revision))
        .step();
  }
}

Counts read_counts(Connection& connection) {
  Statement select(connection, "SELECT places, \"values\", checksum FROM counts WHERE id = 1");
  const int code = select.try_step();
  Counts counts;
  if (code == SQLITE_ROW) {
    counts = {.places = select.integer(0), .values = select.integer(1)};
    if (checksum_of(counts) != select.integer(2)) counts.damage = "its checksum is wrong";
  } else if (code == SQLITE_DONE) {
    counts.damage = "not found";
  } else {
    if (!sqlite::is_damage(code)) connection.fail(code);
    counts.damage = sqlite3_errstr(code);
  }
  if (!counts.damage.empty()) {
    counts.places = largest(connection, "id", "place");
    if (may_have_removed(connection))  // the last place may be one of them
      counts.places = std::max(counts.places, largest(connection, "place", "removed"));
    counts.values = largest(connection, "id", "value");
  }
  // A row takes more than 16 bytes: with this, no file can ask for endless work.
  const int64_t most =
      connection.integer("PRAGMA page_count") * connection.integer("PRAGMA page_size") / 16;
  if (counts.places < 0 || counts.places > most || counts.values < 0 || counts.values > most)
    throw InputError(str(connection.name(), ": this map is damaged: it says that it has ",
                         counts.places, " places and ", counts.values,
                         " values, more than a file of this size can hold"));
  return counts;
}

void write_counts(Connection& connection, const Counts& counts) {
  Statement replace(connection,
                    "INSERT OR REPLACE INTO counts (id, places, \"values\", checksum) "
                    "VALUES (1, ?, ?, ?)");
  replace.bind(1, counts.places).bind(2, counts.values).bind(3, checksum_of(counts)).step();
}

}  // namespace revisit::pipeline
