#include "tables.h"

#include "checksum.h"
#include "identity.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit::pipeline::postgres {

using pqxx::binarystring;

namespace {

constexpr int64_t kMostPlaces = int64_t{1} << 48;  // of any map: ids beyond it may overflow

bool may_have_removed(pqxx::transaction_base& step) {
  const pqxx::result rows = step.exec("SELECT version FROM map WHERE id = 1");
  return !rows.empty() && rows[0][0].as<int>() > kFirstMapVersion;
}

}  // namespace

binarystring bytes_of(std::string_view text) {
  return binarystring(text.data(), text.size());
}

std::string bytes_in(const pqxx::field& field) {
  return field.is_null() ? "" : binarystring(field).str();
}

int64_t value_checksum(std::string_view name, std::string_view bytes) {
  return Checksum().bytes(name).bytes(bytes).value();
}

MapHead read_head(pqxx::transaction_base& step, const std::string& name) {
  const pqxx::result rows = step.exec(
      "SELECT version, identity, bytes_per_number, revision, "
      "checksum FROM map WHERE id = 1");
  if (rows.empty()) throw InputError(str(name, ": the head of this map is damaged: not found"));
  const pqxx::row row = rows[0];
  if (row[0].as<int>() > kMapVersion)
    throw InputError(str(name, ": a map of version ", row[0].as<int>(),
                         ", this program knows version ", kMapVersion, "; use a later revisit"));
  const auto identity = row[1].as<std::string>();
  const auto bytes_per_number = row[2].as<int64_t>(), revision = row[3].as<int64_t>();
  if (head_checksum(identity, bytes_per_number, revision) != row[4].as<int64_t>() ||
      (bytes_per_number != 2 && bytes_per_number != 4))
    throw InputError(str(name, ": the head of this map is damaged: its checksum is wrong"));
  return {.identity = identity_from(identity),
          .format = bytes_per_number == 2 ? NumberFormat::kFloat16 : NumberFormat::kFloat32,
          .revision = revision};
}

void write_head(pqxx::transaction_base& step, const MapHead& head) {
  const std::string identity = text_of(head.identity);
  const int64_t bytes_per_number = head.format == NumberFormat::kFloat16 ? 2 : 4;
  step.exec_params(
      "INSERT INTO map VALUES (1, $1, $2, $3, $4, $5) ON CONFLICT (id) DO UPDATE SET revision = "
      "EXCLUDED.revision, checksum = EXCLUDED.checksum",
      kFirstMapVersion, identity, bytes_per_number, head.revision,
      head_checksum(identity, bytes_per_number, head.revision));
}

void write_places(pqxx::transaction_base& step, int64_t places) {
  step.exec_params(
      "INSERT INTO counts VALUES (1, $1, $2) ON CONFLICT (id) DO UPDATE SET places = "
      "EXCLUDED.places, checksum = EXCLUDED.checksum",
      places, checksum_of(Counts{.places = places, .values = 0, .damage = ""}));
}

bool has_table(pqxx::transaction_base& step, const std::string& map, const std::string& table) {
  // Not to_regclass(): it remembers within a transaction that there was no such schema.
  return !step.exec_params("SELECT 1 FROM pg_tables WHERE schemaname = $1 AND tablename = $2", map,
                           table)
              .empty();
}

int64_t read_places(pqxx::transaction_base& step, const std::string& name, const char* lock,
                    std::string* damage) {
  pqxx::result rows = step.exec(str("SELECT places, checksum FROM counts WHERE id = 1", lock));
  const auto is_sound = [](const pqxx::row& row) {
    return checksum_of(Counts{.places = row[0].as<int64_t>(), .values = 0, .damage = ""}) ==
           row[1].as<int64_t>();
  };
  if (rows.empty() || !is_sound(rows[0])) {
    if (damage != nullptr) *damage = rows.empty() ? "not found" : "its checksum is wrong";
    const bool removed = may_have_removed(step);  // the last place may be one of them
    rows = step.exec(str("SELECT coalesce(max(id), 0) FROM (SELECT id FROM place",
                         removed ? " UNION ALL SELECT place FROM removed" : "", ") AS there"));
  }
  const auto places = rows[0][0].as<int64_t>();
  if (places < 0 || places > kMostPlaces)
    throw InputError(str(name, ": this map is damaged: it says that it has ", places, " places"));
  return places;
}

int64_t count_removed(pqxx::transaction_base& step, int64_t there) {
  if (!may_have_removed(step)) return 0;
  return step.exec_params("SELECT count(*) FROM removed WHERE place BETWEEN 1 AND $1", there)[0][0]
      .as<int64_t>();
}

int64_t last_removal(pqxx::transaction_base& step) {
  if (!may_have_removed(step)) return 0;
  return step.exec("SELECT coalesce(max(id), 0) FROM removed")[0][0].as<int64_t>();
}

std::string damage_of_removed(pqxx::transaction_base& step, int64_t there) {
  const RemovedPlaces removed = read_removed(step, "true");
  const std::string damage = damage_of(removed, there);
  if (!damage.empty() || removed.ids.empty()) return damage;
  const pqxx::result both =
      step.exec("SELECT min(id) FROM place WHERE id IN (SELECT place FROM removed)");
  return both[0][0].is_null() ? ""
                              : str("it has place ", both[0][0].as<int64_t>(), ", which is there");
}

RemovedPlaces read_removed(pqxx::transaction_base& step, const std::string& where) {
  RemovedPlaces removed;
  if (!may_have_removed(step)) return removed;
  const pqxx::result rows =
      step.exec(str("SELECT id, place, checksum FROM removed WHERE ", where, " ORDER BY id"));
  for (const pqxx::row& row : rows) {
    const auto id = row[0].as<int64_t>(), place = row[1].as<int64_t>();
    if (removed_checksum(id, place) == row[2].as<int64_t>())
      removed.ids.push_back(place);
    else if (removed.damage.empty())
      removed.damage = str("the checksum of entry ", id, " is wrong");
  }
  return removed;
}

void remove_places(pqxx::transaction_base& step, const std::set<int64_t>& places) {
  step.exec(kTableOfRemoved);
  step.exec(kTableOfExpected);
  step.exec(str("UPDATE map SET version = ", kMapVersion, " WHERE id = 1"));
  int64_t id = last_removal(step);
  for (const int64_t place : places) {
    ++id;
    step.exec_params("DELETE FROM place WHERE id = $1", place);
    step.exec_params("DELETE FROM expected WHERE place = $1", place);  // may be described again
    step.exec_params(
        "INSERT INTO removed VALUES ($1, $2, $3) ON CONFLICT (place) DO UPDATE SET id = "
        "EXCLUDED.id, checksum = EXCLUDED.checksum",
        id, place, removed_checksum(id, place));
  }
}

int64_t lock_places(pqxx::transaction_base& step, const std::string& name) {
  return read_places(step, name, " FOR UPDATE");
}

void write_place(pqxx::transaction_base& step, const char* sql, int64_t id,
                 const StoredPlace& place, const PlaceRow& row, int64_t revision, int64_t call) {
  const RowView view = view_of(place, row, revision);
  const std::string time = view.time ? exact(*view.time) : "";  // in every locale
  step.exec_params(sql, id, place.drive, view.frame, time, bytes_of(view.pose),
                   bytes_of(view.descriptor), bytes_of(view.feature), revision,
                   checksum_of(id, view), call);
}

}  // namespace revisit::pipeline::postgres
