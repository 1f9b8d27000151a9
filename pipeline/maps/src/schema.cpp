#include "schema.h"

#include <array>
#include <vector>

#include "checksum.h"
#include "identity.h"
#include "revisit/base/error.h"

namespace revisit {
namespace {

using sqlite::Connection;
using sqlite::Statement;

constexpr std::array kMapTables{
    "CREATE TABLE map (id INTEGER PRIMARY KEY, identity TEXT, bytes_per_number INTEGER, revision "
    "INTEGER, checksum INTEGER)",
    "CREATE TABLE map_copy (id INTEGER PRIMARY KEY, identity TEXT, bytes_per_number INTEGER, "
    "revision INTEGER, checksum INTEGER)",
    "CREATE TABLE counts (id INTEGER PRIMARY KEY, places INTEGER, \"values\" INTEGER, checksum "
    "INTEGER)",
    "CREATE TABLE value (id INTEGER PRIMARY KEY, name TEXT, bytes BLOB, checksum INTEGER)",
    "CREATE TABLE place (id INTEGER PRIMARY KEY, drive TEXT, frame INTEGER, time REAL, pose BLOB, "
    "descriptor BLOB, feature BLOB, revision INTEGER, checksum INTEGER)",
};
constexpr const char* kRemovedTable =  // after these; created by the first removal
    "CREATE TABLE removed (id INTEGER PRIMARY KEY, place INTEGER, checksum INTEGER)";
constexpr const char* kCloudTable =  // after that; created by the first cloud
    "CREATE TABLE cloud (id INTEGER PRIMARY KEY, bytes BLOB, checksum INTEGER)";

}  // namespace

int64_t head_checksum(std::string_view identity, int64_t bytes_per_number, int64_t revision) {
  return Checksum().bytes(identity).number(bytes_per_number).number(revision).value();
}

int64_t checksum_of(const Counts& counts) {
  return Checksum().number(counts.places).number(counts.values).value();
}

void make_map(Connection& connection, const MapHead& head) {
  connection.execute(str("PRAGMA page_size = ", kPageSize));
  connection.execute("PRAGMA auto_vacuum = NONE");
  connection.execute(str("PRAGMA application_id = ", kApplicationId));
  connection.execute(str("PRAGMA user_version = ", kFirstMapVersion));
  for (const char* table : kMapTables) connection.execute(table);
  write_head(connection, head);
  write_counts(connection, {});
}

bool may_have_removed(Connection& connection) {
  return connection.integer("PRAGMA user_version") > kFirstMapVersion;
}

void make_table_of_removed(Connection& connection) {
  if (may_have_removed(connection)) return;
  connection.execute(kRemovedTable);
  connection.execute(str("PRAGMA user_version = ", kRemovedMapVersion));
}

bool may_have_clouds(Connection& connection) {
  return connection.integer("PRAGMA user_version") >= kMapVersion;
}

void make_table_of_clouds(Connection& connection) {
  if (may_have_clouds(connection)) return;
  make_table_of_removed(connection);
  connection.execute(kCloudTable);
  connection.execute(str("PRAGMA user_version = ", kMapVersion));
}

int64_t cloud_checksum(int64_t id, std::string_view bytes) {
  return Checksum().number(id).bytes(bytes).value();
}

void check_schema(Connection& connection) {
  const int64_t version = connection.integer("PRAGMA user_version");
  if (version > kMapVersion)
    throw InputError(connection.name(), ": map version ", version, " (expected at most ",
                     kMapVersion, "); use a newer revisit");
  if (version < kFirstMapVersion) connection.fail_corrupt(str("its version is ", version));
  // A writer would use other pages as pages of entries.
  if (connection.integer("PRAGMA auto_vacuum") != 0) connection.fail_corrupt("it has auto_vacuum");
  std::vector<std::string> expected(kMapTables.begin(), kMapTables.end()), found;
  if (version >= kRemovedMapVersion) expected.emplace_back(kRemovedTable);
  if (version >= kMapVersion) expected.emplace_back(kCloudTable);
  Statement select(connection, "SELECT sql FROM sqlite_schema ORDER BY rowid");
  while (found.size() <= expected.size() && select.step()) found.emplace_back(select.bytes(0));
  if (found != expected) connection.fail_corrupt("its tables are not those of a map");
}

MapHead read_head(Connection& connection) {
  Statement select(connection,
                   "SELECT identity, bytes_per_number, revision, checksum FROM map WHERE id = 1");
  if (!select.step()) connection.fail_corrupt("its header is missing");
  const std::string text(select.bytes(0));
  const int64_t bytes_per_number = select.integer(1);
  if (head_checksum(text, bytes_per_number, select.integer(2)) != select.integer(3) ||
      (bytes_per_number != 2 && bytes_per_number != 4))
    connection.fail_corrupt("the checksum of its header is wrong");
  return {.identity = identity_from(text),
          .format = bytes_per_number == 2 ? DescriptorType::kFloat16 : DescriptorType::kFloat32,
          .revision = select.integer(2)};
}

void write_head(Connection& connection, const MapHead& head) {
  const std::string text = text_of(head.identity);
  const int64_t bytes_per_number = head.format == DescriptorType::kFloat16 ? 2 : 4;
  // Older programs also read the copy.
  for (const char* table : {"map", "map_copy"}) {
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
  if (!select.step()) connection.fail_corrupt("the number of its places is missing");
  const Counts counts{.places = select.integer(0), .values = select.integer(1)};
  if (checksum_of(counts) != select.integer(2))
    connection.fail_corrupt("the checksum of the number of its places is wrong");
  // A row takes more than 16 bytes.
  const int64_t most =
      connection.integer("PRAGMA page_count") * connection.integer("PRAGMA page_size") / 16;
  if (counts.places < 0 || counts.places > most || counts.values < 0 || counts.values > most)
    connection.fail_corrupt(str("its header claims ", counts.places, " places and ", counts.values,
                                " values, more than a file of its size can hold"));
  return counts;
}

void write_counts(Connection& connection, const Counts& counts) {
  Statement replace(connection,
                    "INSERT OR REPLACE INTO counts (id, places, \"values\", checksum) "
                    "VALUES (1, ?, ?, ?)");
  replace.bind(1, counts.places).bind(2, counts.values).bind(3, checksum_of(counts)).step();
}

}  // namespace revisit
