#include "removed_places.h"

#include <cstdint>
#include <iterator>
#include <set>

#include "checksum.h"
#include "schema.h"

namespace revisit::pipeline {

using sqlite::Statement;

namespace {

int64_t number_of_removed(sqlite::Connection& connection, const std::string& what) {
  if (!may_have_removed(connection)) return 0;
  Statement select(connection, "SELECT " + what);
  const int code = select.try_step();
  if (code == SQLITE_ROW) return select.integer(0);
  if (!sqlite::is_damage(code)) connection.fail(code);
  return 0;
}

}  // namespace

int64_t removed_checksum(int64_t id, int64_t place) {
  return Checksum().number(id).number(place).value();
}

std::string damage_of(const RemovedPlaces& removed, int64_t there) {
  if (!removed.damage.empty()) return removed.damage + "; places that it lacks count as lost";
  std::set<int64_t> seen;
  for (const int64_t place : removed.ids) {
    if (place < 1 || place > there) return str("it has place ", place, ", the map has had ", there);
    if (!seen.insert(place).second) return str("it has place ", place, " twice");
  }
  return "";
}

int64_t count_removed(sqlite::Connection& connection, int64_t there) {
  // A stranger's list may hold other numbers than whole ones.
  return number_of_removed(connection,
                           str("count(DISTINCT CAST(place AS INTEGER)) FROM removed WHERE "
                               "CAST(place AS INTEGER) BETWEEN 1 AND ",
                               there));
}

int64_t last_removal(sqlite::Connection& connection) {
  return number_of_removed(connection, "max(id) FROM removed");
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
  if (id > INT64_MAX - std::ssize(places))
    throw InputError(str(connection.name(), ": the list of removed places is damaged: its last ",
                         "entry has the number ", id));
  Statement insert(connection, "INSERT INTO removed (id, place, checksum) VALUES (?, ?, ?)");
  for (const int64_t place : places) {
    ++id;
    insert.reset().bind(1, id).bind(2, place).bind(3, removed_checksum(id, place)).step();
  }
}

}  // namespace revisit::pipeline
