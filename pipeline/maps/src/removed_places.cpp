#include "removed_places.h"

#include "checksum.h"
#include "schema.h"

namespace revisit {

using sqlite::Statement;

int64_t removed_checksum(int64_t id, int64_t place) {
  return Checksum().number(id).number(place).value();
}

int64_t count_removed(sqlite::Connection& connection, int64_t after) {
  if (!may_have_removed(connection)) return 0;
  return connection.integer(str("SELECT count(*) FROM removed WHERE place > ", after));
}

int64_t last_removal(sqlite::Connection& connection) {
  if (!may_have_removed(connection)) return 0;
  return connection.integer("SELECT max(id) FROM removed");
}

std::vector<int64_t> read_removed(sqlite::Connection& connection, int64_t after) {
  std::vector<int64_t> places;
  if (!may_have_removed(connection)) return places;
  Statement select(connection, "SELECT id, place, checksum FROM removed WHERE id > ? ORDER BY id");
  select.bind(1, after);
  while (select.step()) {
    places.push_back(select.integer(1));
    if (removed_checksum(select.integer(0), places.back()) != select.integer(2))
      connection.fail_corrupt("a checksum in the list of removed places is wrong");
  }
  return places;
}

void write_removed(sqlite::Connection& connection, std::span<const int64_t> places) {
  make_table_of_removed(connection);
  Statement insert(connection, "INSERT INTO removed (id, place, checksum) VALUES (?, ?, ?)");
  for (const int64_t place : places) {
    // SQLite computes the id: it fails after the largest number.
    const int64_t id = connection.integer("SELECT ifnull(max(id), 0) + 1 FROM removed");
    insert.reset().bind(1, id).bind(2, place).bind(3, removed_checksum(id, place)).step();
  }
}

}  // namespace revisit
