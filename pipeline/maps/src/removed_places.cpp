#include "removed_places.h"

#include "checksum.h"
#include "schema.h"

namespace revisit::pipeline {

using sqlite::Statement;

int64_t removed_checksum(int64_t id, int64_t place) {
  return Checksum().number(id).number(place).value();
}

int64_t count_removed(sqlite::Connection& connection) {
  if (!may_have_removed(connection)) return 0;
  Statement select(connection, "SELECT max(id) FROM removed");
  const int code = select.try_step();
  if (code == SQLITE_ROW) return select.integer(0);
  if (!sqlite::is_damage(code)) connection.fail(code);
  return 0;
}

RemovedPlaces read_removed(sqlite::Connection& connection, int64_t after) {
  RemovedPlaces removed;
  if (!may_have_removed(connection)) return removed;
  Statement select(connection, "SELECT id, place, checksum FROM removed WHERE id > ? ORDER BY id");
  select.bind(1, after);
  int code = SQLITE_OK;
  while ((code = select.try_step()) == SQLITE_ROW) {
    if (removed_checksum(select.integer(0), select.integer(1)) == select.integer(2))
      removed.ids.push_back(select.integer(1));
    else
      removed.damage = "a checksum is wrong";
  }
  if (code == SQLITE_DONE) return removed;
  if (!sqlite::is_damage(code)) connection.fail(code);
  removed.damage = sqlite3_errstr(code);
  return removed;
}

void write_removed(sqlite::Connection& connection, std::span<const int64_t> places) {
  make_table_of_removed(connection);
  int64_t id = connection.integer("SELECT max(id) FROM removed");
  Statement insert(connection, "INSERT INTO removed (id, place, checksum) VALUES (?, ?, ?)");
  for (const int64_t place : places) {
    ++id;
    insert.reset().bind(1, id).bind(2, place).bind(3, removed_checksum(id, place)).step();
  }
}

}  // namespace revisit::pipeline
