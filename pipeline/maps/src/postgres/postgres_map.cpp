#include "postgres_map.h"

#include <cstdio>
#include <random>
#include <set>

#include "checksum.h"
#include "damaged_places.h"
#include "identity.h"
#include "place_row.h"
#include "revisit/proto/error.h"
#include "schema.h"
#include "server.h"

namespace revisit::pipeline {
namespace {

using pqxx::binarystring;
using Moment = pqxx::transaction<pqxx::repeatable_read, pqxx::read_only>;
using postgres::Server;

constexpr int kPlacesAtOnce = 256;  // in memory

/// Table `place`: `call` is a random number of the call that added the place.
constexpr const char* kTables =
    "CREATE TABLE map (id INTEGER PRIMARY KEY, version INTEGER NOT NULL, identity TEXT NOT NULL, "
    "bytes_per_number INTEGER NOT NULL, revision BIGINT NOT NULL, checksum BIGINT NOT NULL);"
    "CREATE TABLE counts (id INTEGER PRIMARY KEY, places BIGINT NOT NULL, checksum BIGINT NOT "
    "NULL);"
    "CREATE TABLE value (name TEXT PRIMARY KEY, bytes BYTEA NOT NULL, checksum BIGINT NOT NULL);"
    "CREATE TABLE place (id BIGINT PRIMARY KEY, drive TEXT NOT NULL, frame BIGINT NOT NULL, time "
    "FLOAT8, pose BYTEA, descriptor BYTEA NOT NULL, feature BYTEA, revision BIGINT NOT NULL, "
    "checksum BIGINT NOT NULL, call BIGINT NOT NULL)";

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
      kMapVersion, identity, bytes_per_number, head.revision,
      head_checksum(identity, bytes_per_number, head.revision));
}

void write_places(pqxx::transaction_base& step, int64_t places) {
  step.exec_params(
      "INSERT INTO counts VALUES (1, $1, $2) ON CONFLICT (id) DO UPDATE SET places = "
      "EXCLUDED.places, checksum = EXCLUDED.checksum",
      places, checksum_of(Counts{.places = places, .values = 0, .damage = ""}));
}

/// How many places there are; `damage`: when that had to be taken from the places, why.
int64_t read_places(pqxx::transaction_base& step, const char* lock, std::string* damage = nullptr) {
  const pqxx::result rows =
      step.exec(str("SELECT places, checksum FROM counts WHERE id = 1", lock));
  if (!rows.empty()) {
    const auto places = rows[0][0].as<int64_t>();
    if (checksum_of(Counts{.places = places, .values = 0, .damage = ""}) ==
        rows[0][1].as<int64_t>())
      return places;
  }
  if (damage != nullptr) *damage = rows.empty() ? "not found" : "its checksum is wrong";
  return step.exec("SELECT coalesce(max(id), 0) FROM place")[0][0].as<int64_t>();
}

/// One who adds or changes has this row until the commit. So ids are given in the order of the
/// commits: a reader who has seen id 7 never meets a 6 that was committed later, as it would with a
/// sequence. It also waits for a lost connection's own commit to end.
int64_t lock_places(pqxx::transaction_base& step) {
  return read_places(step, " FOR UPDATE");
}

void write_place(pqxx::transaction_base& step, const char* sql, int64_t id,
                 const StoredPlace& place, const PlaceRow& row, int64_t revision, int64_t call) {
  const RowView view = view_of(place, row, revision);
  char time[40] = "";
  if (view.time) std::snprintf(time, sizeof(time), "%.17g", *view.time);
  step.exec_params(sql, id, place.drive, view.frame, std::string(time), bytes_of(view.pose),
                   bytes_of(view.descriptor), bytes_of(view.feature), revision,
                   checksum_of(id, view), call);
}
constexpr const char* kInsert =
    "INSERT INTO place VALUES ($1, $2, $3, nullif($4, '')::float8, nullif($5::bytea, ''), "
    "$6::bytea, nullif($7::bytea, ''), $8, $9, $10)";
/// With the same parameters, for a place that is there.
constexpr const char* kReplace =
    "UPDATE place SET drive = $2, frame = $3, time = nullif($4, '')::float8, pose = "
    "nullif($5::bytea, ''), descriptor = $6::bytea, feature = nullif($7::bytea, ''), revision = "
    "$8, checksum = $9, call = $10 WHERE id = $1";

/// Hands over the places above `last`, up to `places`, and moves `last`.
template <class Take, class Damage>
void select_places(pqxx::transaction_base& step, const MapHead& head, int64_t places, int64_t& last,
                   const Take& take, const Damage& damaged) {
  while (last < places) {
    const int64_t end = std::min(places, last + kPlacesAtOnce);
    const pqxx::result rows = step.exec_params(
        "SELECT id, drive, frame, time, pose, descriptor, feature, revision, checksum, call FROM "
        "place WHERE id > $1 AND id <= $2 ORDER BY id",
        last, end);
    for (const pqxx::row& found : rows) {
      const auto id = found[0].as<int64_t>();
      while (++last < id) damaged(last, "not found");
      const std::string drive = found[1].as<std::string>(), pose = bytes_in(found[4]),
                        descriptor = bytes_in(found[5]), feature = bytes_in(found[6]);
      RowView row{.drive = drive,
                  .frame = found[2].as<int64_t>(),
                  .pose = pose,
                  .descriptor = descriptor,
                  .feature = feature,
                  .revision = found[7].as<int64_t>(),
                  .checksum = found[8].as<int64_t>()};
      if (!found[3].is_null()) row.time = found[3].as<double>();
      StoredPlace place;
      const std::string damage = take_row(id, row, head.format, head.revision, place);
      if (damage.empty())
        take(std::move(place), found[9].as<int64_t>());
      else
        damaged(id, damage);
    }
    while (last < end) damaged(++last, "not found");
  }
}

/// A map in a schema of a PostgreSQL database.
class PostgresMap : public MapStore {
 public:
  PostgresMap(std::unique_ptr<Server> server, MapAccess access, MapHead head)
      : server_(std::move(server)), access_(access), head_(std::move(head)) {}

  const MapIdentity& identity() const override { return head_.identity; }
  NumberFormat number_format() const override { return head_.format; }

  int64_t size() const override {
    return server_->run([&](pqxx::connection& connection) {
      Moment moment(connection);
      return read_places(moment, "");
    });
  }

  std::optional<std::string> value(const std::string& name) const override {
    return server_->run([&](pqxx::connection& connection) -> std::optional<std::string> {
      Moment moment(connection);
      const pqxx::result rows =
          moment.exec_params("SELECT bytes, checksum FROM value WHERE name = $1", name);
      if (rows.empty()) return std::nullopt;
      std::string bytes = bytes_in(rows[0][0]);
      if (value_checksum(name, bytes) != rows[0][1].as<int64_t>())
        throw InputError(
            str(server_->name(), ": the value '", name, "' is damaged: its checksum is wrong"));
      return bytes;
    });
  }

  void set_value(const std::string& name, const std::string& bytes) override {
    must_be_writer();
    server_->run([&](pqxx::connection& connection) {
      pqxx::work step(connection);
      lock_places(step);
      put_value(step, name, bytes);
      server_->tell_others(step);
      step.commit();
    });
  }

  std::vector<int64_t> add(std::span<const StoredPlace> places,
                           std::optional<int64_t> revision) override {
    must_be_writer();
    if (places.empty()) return {};
    std::vector<PlaceRow> rows;
    for (const StoredPlace& place : places)
      rows.push_back(place_row(place, head_.format, rows.size() + 1));
    const auto call = static_cast<int64_t>((uint64_t{random_()} << 32) | random_());
    int64_t first = 0;  // the first id of the try before this one
    return server_->run([&](pqxx::connection& connection) {
      std::vector<int64_t> ids;
      pqxx::work step(connection);
      const int64_t there = lock_places(step);
      // A connection that is lost in a commit leaves open what became of it: the place says it.
      const bool was_added =
          first > 0 &&
          !step.exec_params("SELECT 1 FROM place WHERE id = $1 AND call = $2", first, call).empty();
      if (!was_added) {
        const MapHead head = read_head(step, server_->name());
        if (revision && *revision != head.revision) return ids;
        first = there + 1;
        for (size_t i = 0; i < rows.size(); ++i)
          write_place(step, kInsert, first + static_cast<int64_t>(i), places[i], rows[i],
                      head.revision, call);
        write_places(step, there + static_cast<int64_t>(rows.size()));
        server_->tell_others(step);
        step.commit();
      }
      for (size_t i = 0; i < rows.size(); ++i) ids.push_back(first + static_cast<int64_t>(i));
      return ids;
    });
  }

  MapPosition read(int64_t after, const Take& take, const Damaged& damaged) const override {
    const auto tell_once = [&](const std::string& what) {
      if (told_.insert(what).second) damaged(what);
    };
    MapPosition at{.last = std::max<int64_t>(after, 0), .revision = -1};
    DamagedPlaces places(server_->name(), damaged);
    server_->forget_news();  // before the moment: what comes later is told again
    server_->run([&](pqxx::connection& connection) {
      connection.get_notifs();
      server_->forget_news();
      Moment moment(connection);
      const MapHead head = read_head(moment, server_->name());
      std::string damage;
      const int64_t there = read_places(moment, "", &damage);
      if (!damage.empty())
        tell_once(str(server_->name(), ": the number of places is damaged: ", damage, "; ", there,
                      " is the last that was found"));
      // The connection was lost on the way, and the moment is another: the next read() goes on.
      if (at.revision >= 0 && at.revision != head.revision) return;
      at.revision = head.revision;
      select_places(
          moment, head, there, at.last,
          [&](StoredPlace&& place, int64_t) {
            places.flush();
            take(std::move(place));
          },
          [&](int64_t id, const std::string& reason) { places.add(id, reason); });
    });
    places.flush();
    return at;
  }

  bool has_news(std::chrono::milliseconds wait) override { return server_->was_told(wait); }

  bool replace_descriptors(
      const std::function<std::vector<float>(const StoredPlace&)>& descriptor_of,
      const std::map<std::string, std::string>& values, int64_t revision) override {
    must_be_writer();
    return server_->run([&](pqxx::connection& connection) {
      pqxx::work step(connection);
      const int64_t there = lock_places(step);
      MapHead head = read_head(step, server_->name());
      if (head.revision != revision) return false;
      int64_t last = 0;
      select_places(
          step, head, there, last,
          [&](StoredPlace&& place, int64_t call) {
            place.descriptor = descriptor_of(place);
            place.feature.clear();
            write_place(step, kReplace, place.id, place, place_row(place, head.format, place.id),
                        revision + 1, call);
          },
          [](int64_t, const std::string&) {});
      ++head.revision;
      write_head(step, head);
      for (const auto& [name, bytes] : values) put_value(step, name, bytes);
      server_->tell_others(step);
      step.commit();
      return true;
    });
  }

  std::vector<std::string> check() const {
    std::vector<std::string> wrong;
    const auto add_to = [&](const std::string& what) { wrong.push_back(what); };
    read(
        0, [](StoredPlace&&) {}, add_to);
    const pqxx::result values = server_->run([&](pqxx::connection& connection) {
      Moment moment(connection);
      return moment.exec("SELECT name, bytes, checksum FROM value ORDER BY name");
    });
    for (const pqxx::row& row : values)
      if (value_checksum(row[0].as<std::string>(), bytes_in(row[1])) != row[2].as<int64_t>())
        add_to(str(server_->name(), ": the value '", row[0].as<std::string>(),
                   "' is damaged: its checksum is wrong"));
    return wrong;
  }

 private:
  void must_be_writer() const {
    if (access_ == MapAccess::kRead)
      throw UsageError(str(server_->name(), ": this map was opened for reading (MapAccess)"));
  }

  static void put_value(pqxx::transaction_base& step, const std::string& name,
                        const std::string& bytes) {
    step.exec_params(
        "INSERT INTO value VALUES ($1, $2, $3) ON CONFLICT (name) DO UPDATE SET bytes = "
        "EXCLUDED.bytes, checksum = EXCLUDED.checksum",
        name, bytes_of(bytes), value_checksum(name, bytes));
  }

  std::unique_ptr<Server> server_;
  MapAccess access_;
  MapHead head_;  // as it was when the map was opened
  std::random_device random_;
  mutable std::set<std::string> told_;
};

/// `identity`: the map is made with it when there is none.
std::unique_ptr<PostgresMap> open_map_at(const std::string& where, MapAccess access,
                                         const MapIdentity* identity, NumberFormat format) {
  auto server = std::make_unique<Server>(postgres::parse_address(where));
  const MapHead head = server->run([&](pqxx::connection& connection) {
    pqxx::work step(connection);
    // Not to_regclass(): it remembers within a transaction that there was no such schema.
    const auto is_there = [&] {
      return !step.exec_params(
                      "SELECT 1 FROM pg_tables WHERE schemaname = $1 AND tablename = 'map'",
                      server->map())
                  .empty();
    };
    if (!is_there()) {
      if (identity == nullptr || access == MapAccess::kRead)
        throw InputError(
            str(server->name(), ": there is no map '", server->map(), "' in this database"));
      step.exec(str("SELECT pg_advisory_xact_lock(", kApplicationId, ")"));  // one makes it
      if (!is_there()) {
        step.exec(str("CREATE SCHEMA IF NOT EXISTS ", server->map()));
        step.exec(kTables);
        write_head(step, {.identity = *identity, .format = format});
        write_places(step, 0);
      }
    }
    // Without this right the server would say that there are no tables.
    if (!step.exec_params("SELECT has_schema_privilege($1, 'USAGE')", server->map())[0][0]
             .as<bool>())
      throw Error(str(server->name(), ": the server does not allow it: no right to use the schema ",
                      server->map(), "; give this user the right, or use another"));
    MapHead found = read_head(step, server->name());
    step.commit();
    return found;
  });
  return std::make_unique<PostgresMap>(std::move(server), access, head);
}

}  // namespace

std::unique_ptr<MapStore> open_postgres_map(const std::string& where, MapAccess access,
                                            const MapIdentity* identity, NumberFormat format) {
  auto map = open_map_at(where, access, identity, format);
  if (identity != nullptr)
    must_match(postgres::parse_address(where).name, map->identity(), *identity);
  return map;
}

std::vector<std::string> check_postgres_map(const std::string& where) {
  const auto map = open_map_at(where, MapAccess::kRead, nullptr, NumberFormat::kFloat32);
  return map->check();
}

}  // namespace revisit::pipeline
