#include "tables.h"

#include <algorithm>
#include <random>

#include "checksum.h"
#include "identity.h"
#include "removed_places.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit::postgres {

using pqxx::binarystring;

namespace {

constexpr int64_t kMaxPlaces = int64_t{1} << 48;  // limit for any map: larger ids may overflow

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
  if (rows.empty()) throw InputError(name, ": this map is corrupt: its header is missing");
  const pqxx::row row = rows[0];
  if (row[0].as<int>() > kMapVersion)
    throw InputError(name, ": map version ", row[0].as<int>(), " (expected at most ", kMapVersion,
                     "); use a newer revisit");
  const auto identity = row[1].as<std::string>();
  const auto bytes_per_number = row[2].as<int64_t>(), revision = row[3].as<int64_t>();
  if (head_checksum(identity, bytes_per_number, revision) != row[4].as<int64_t>() ||
      (bytes_per_number != 2 && bytes_per_number != 4))
    throw InputError(name, ": this map is corrupt: the checksum of its header is wrong");
  return {.identity = identity_from(identity),
          .format = bytes_per_number == 2 ? DescriptorType::kFloat16 : DescriptorType::kFloat32,
          .revision = revision};
}

void write_head(pqxx::transaction_base& step, const MapHead& head) {
  const std::string identity = text_of(head.identity);
  const int64_t bytes_per_number = head.format == DescriptorType::kFloat16 ? 2 : 4;
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
      places, checksum_of(Counts{.places = places}));
}

bool has_table(pqxx::transaction_base& step, const std::string& map, const std::string& table) {
  // Not to_regclass(), which caches within a transaction that a schema is missing.
  return !step.exec_params("SELECT 1 FROM pg_tables WHERE schemaname = $1 AND tablename = $2", map,
                           table)
              .empty();
}

int64_t read_places(pqxx::transaction_base& step, const std::string& name, const char* lock) {
  const pqxx::result rows =
      step.exec(str("SELECT places, checksum FROM counts WHERE id = 1", lock));
  const auto places = rows.empty() ? -1 : rows[0][0].as<int64_t>();
  if (places < 0 || places > kMaxPlaces ||
      checksum_of(Counts{.places = places}) != rows[0][1].as<int64_t>())
    throw InputError(name, ": this map is corrupt: the number of its places is ",
                     rows.empty() ? "missing" : "wrong", "; restore a copy");
  return places;
}

int64_t count_removed(pqxx::transaction_base& step, int64_t after) {
  if (!may_have_removed(step)) return 0;
  return step.exec_params("SELECT count(*) FROM removed WHERE place > $1", after)[0][0]
      .as<int64_t>();
}

int64_t last_removal(pqxx::transaction_base& step) {
  if (!may_have_removed(step)) return 0;
  return step.exec("SELECT coalesce(max(id), 0) FROM removed")[0][0].as<int64_t>();
}

std::vector<int64_t> read_removed(pqxx::transaction_base& step, const std::string& name,
                                  int64_t after) {
  std::vector<int64_t> places;
  if (!may_have_removed(step)) return places;
  for (const pqxx::row& row : step.exec_params(
           "SELECT id, place, checksum FROM removed WHERE id > $1 ORDER BY id", after)) {
    places.push_back(row[1].as<int64_t>());
    if (removed_checksum(row[0].as<int64_t>(), places.back()) != row[2].as<int64_t>())
      throw InputError(name, ": this map is corrupt: a checksum in the list of removed places ",
                       "is wrong; restore a copy");
  }
  return places;
}

void remove_places(pqxx::transaction_base& step, const std::set<int64_t>& places) {
  step.exec(kTableOfRemoved);
  step.exec(kTableOfExpected);
  step.exec(kTableOfClouds);
  step.exec(str("UPDATE map SET version = ", kRemovedMapVersion, " WHERE id = 1"));
  const auto n = static_cast<int64_t>(places.size());
  // The server computes the id: it fails after the largest number.
  const auto last = step.exec(str("SELECT coalesce(max(id), 0) + ", n, " FROM removed"))[0][0];
  int64_t id = last.as<int64_t>() - n;
  for (const int64_t place : places) {
    ++id;
    step.exec_params("DELETE FROM place WHERE id = $1", place);
    step.exec_params("DELETE FROM cloud WHERE id = $1", place);
    step.exec_params("DELETE FROM expected WHERE place = $1",
                     place);  // the frame can be enqueued again
    step.exec_params("INSERT INTO removed VALUES ($1, $2, $3)", id, place,
                     removed_checksum(id, place));
  }
}

NewPlaces::NewPlaces(std::span<const StoredPlace> of, DescriptorType format) : places(of) {
  std::random_device random;
  call = static_cast<int64_t>((uint64_t{random()} << 32) | random());
  for (const StoredPlace& place : places) rows.push_back(place_row(place, format, rows.size() + 1));
}

int64_t insert_places(pqxx::transaction_base& step, const NewPlaces& all, int64_t there,
                      const MapHead& head) {
  for (size_t i = 0; i < all.rows.size(); ++i)
    write_place(step, kInsertPlaceAt, there + 1 + static_cast<int64_t>(i), all.places[i],
                all.rows[i], head.revision, all.call);
  if (std::ranges::any_of(all.places, [](const StoredPlace& p) { return !p.cloud.empty(); }))
    step.exec(kTableOfClouds);
  for (size_t i = 0; i < all.places.size(); ++i) {
    const std::string& cloud = all.places[i].cloud;
    const int64_t id = there + 1 + static_cast<int64_t>(i);
    if (!cloud.empty())
      step.exec_params("INSERT INTO cloud VALUES ($1, $2, $3)", id, bytes_of(cloud),
                       cloud_checksum(id, cloud));
  }
  write_places(step, there + static_cast<int64_t>(all.rows.size()));
  return there + 1;
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

}  // namespace revisit::postgres
