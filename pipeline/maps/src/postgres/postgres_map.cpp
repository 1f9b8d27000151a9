#include "postgres_map.h"

#include <algorithm>
#include <set>

#include "identity.h"
#include "revisit/base/error.h"
#include "server.h"
#include "tables.h"

namespace revisit {
namespace {

using Moment = pqxx::transaction<pqxx::repeatable_read, pqxx::read_only>;
using namespace postgres;

class PostgresMap : public MapStore {
 public:
  PostgresMap(std::unique_ptr<Server> server, MapAccess access, MapHead head)
      : server_(std::move(server)), access_(access), head_(std::move(head)) {}

  const MapFingerprint& fingerprint() const override { return head_.identity; }
  DescriptorType descriptor_type() const override { return head_.format; }

  int64_t size() const override {
    return server_->run([&](pqxx::connection& connection) {
      Moment moment(connection);
      return std::max<int64_t>(0, read_places(moment, server_->name()) - count_removed(moment, 0));
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
            str(server_->name(), ": the value '", name, "' is corrupt: its checksum is wrong"));
      return bytes;
    });
  }

  void set_value(const std::string& name, const std::string& bytes) override {
    must_be_writer();
    server_->run([&](pqxx::connection& connection) {
      pqxx::work step(connection);
      lock_places(step, server_->name());
      put_value(step, name, bytes);
      server_->notify_others(step);
      step.commit();
    });
  }

  std::vector<int64_t> add(std::span<const StoredPlace> places,
                           std::optional<int64_t> revision) override {
    must_be_writer();
    const NewPlaces all(places, head_.format);
    if (places.empty()) return {};
    int64_t first = 0;  // first id of the previous attempt
    return server_->run([&](pqxx::connection& connection) {
      std::vector<int64_t> ids;
      pqxx::work step(connection);
      const int64_t there = lock_places(step, server_->name());
      // After a lost commit the outcome is unknown; look for the row with this call id.
      const bool was_added =
          first > 0 &&
          !step.exec_params("SELECT 1 FROM place WHERE id = $1 AND call = $2", first, all.call)
               .empty();
      if (!was_added) {
        const MapHead head = read_head(step, server_->name());
        if (revision && *revision != head.revision) return ids;
        first = insert_places(step, all, there, head);
        server_->notify_others(step);
        step.commit();
      }
      for (size_t i = 0; i < places.size(); ++i) ids.push_back(first + static_cast<int64_t>(i));
      return ids;
    });
  }

  MapState read(int64_t after, const Take& take, const Warn& warn) const override {
    MapState at{.last = std::max<int64_t>(after, 0), .revision = -1};
    server_->clear_updates();  // before the snapshot: later changes send another notification
    server_->run([&](pqxx::connection& connection) {
      connection.get_notifs();
      server_->clear_updates();
      Moment moment(connection);
      const MapHead head = read_head(moment, server_->name());
      const int64_t there = read_places(moment, server_->name());
      // A lost connection began another snapshot, with other descriptors: the next read() resumes.
      if (at.revision >= 0 && at.revision != head.revision) return server_->keep_updates();
      // From the first snapshot, because entries removed later may already have been passed on.
      if (at.revision < 0) at.removed = last_removal(moment);
      at.revision = head.revision;
      at.last = std::min(at.last, there);
      const int64_t behind = at.last, expected = there - behind - count_removed(moment, behind);
      const int64_t found = select_places(
          moment, head, there, at.last,
          [&](StoredPlace&& place, int64_t) { take(std::move(place)); },
          [&](int64_t id, const std::string& defect) {
            warn(str(server_->name(), ": place ", id, " is corrupt: ", defect));
          });
      if (found != expected)
        warn(str(server_->name(), ": it has ", found, " places after place ", behind, ", expected ",
                 expected, "; restore a copy"));
    });
    return at;
  }

  bool reserve_drive(const std::string& drive, const std::string& content) override {
    must_be_writer();
    check_drive(drive);
    return server_->run([&](pqxx::connection& connection) {
      pqxx::work step(connection);
      const std::string name = "recording of " + drive;
      step.exec_params("INSERT INTO value VALUES ($1, $2, $3) ON CONFLICT (name) DO NOTHING", name,
                       bytes_of(content), value_checksum(name, content));
      const pqxx::result kept = step.exec_params("SELECT bytes FROM value WHERE name = $1", name);
      step.commit();
      return bytes_in(kept[0][0]) == content;
    });
  }

  bool has_updates() override { return server_->has_notifications(); }

  bool replace_descriptors(
      const std::function<std::vector<float>(const StoredPlace&)>& descriptor_of,
      const std::map<std::string, std::string>& values, int64_t revision) override {
    must_be_writer();
    return server_->run([&](pqxx::connection& connection) {
      pqxx::work step(connection);
      const int64_t there = lock_places(step, server_->name());
      MapHead head = read_head(step, server_->name());
      if (head.revision != revision) return false;
      int64_t last = 0;
      select_places(
          step, head, there, last,
          [&](StoredPlace&& place, int64_t call) {
            place.descriptor = descriptor_of(place);
            place.feature.clear();
            write_place(step, kReplacePlaceAt, place.id, place,
                        place_row(place, head.format, place.id), revision + 1, call);
          },
          [](int64_t, const std::string&) {});
      ++head.revision;
      write_head(step, head);
      for (const auto& [name, bytes] : values) put_value(step, name, bytes);
      server_->notify_others(step);
      step.commit();
      return true;
    });
  }

  std::string cloud(int64_t id) const override {
    return server_->run([&](pqxx::connection& connection) -> std::string {
      Moment moment(connection);
      if (!has_table(moment, server_->map(), "cloud")) return "";
      const pqxx::result rows =
          moment.exec_params("SELECT bytes, checksum FROM cloud WHERE id = $1", id);
      if (rows.empty()) return "";
      std::string bytes = bytes_in(rows[0][0]);
      if (cloud_checksum(id, bytes) != rows[0][1].as<int64_t>())
        throw InputError(server_->name(), ": the points of place ", id,
                         " are corrupt: their checksum is wrong");
      return bytes;
    });
  }

  int64_t remove(std::span<const int64_t> ids) override {
    must_be_writer();
    std::set<int64_t> to_remove;  // ids of the first attempt
    return server_->run([&](pqxx::connection& connection) {
      pqxx::work step(connection);
      const int64_t there = lock_places(step, server_->name());
      std::set<int64_t> left = ids_to_remove(ids, there);
      for (const int64_t id : read_removed(step, server_->name(), 0)) left.erase(id);
      if (to_remove.empty()) to_remove = left;
      if (!left.empty()) {
        remove_places(step, left);
        server_->notify_others(step);
        step.commit();
      }
      return static_cast<int64_t>(to_remove.size());
    });
  }

  std::vector<int64_t> removed(int64_t after) const override {
    return server_->run([&](pqxx::connection& connection) {
      Moment moment(connection);
      return read_removed(moment, server_->name(), after);
    });
  }

  void check(const Warn& wrong) const override {
    read(
        0, [](StoredPlace&&) {}, wrong);
    removed(0);
    const pqxx::result names = server_->run([&](pqxx::connection& connection) {
      Moment moment(connection);
      return moment.exec("SELECT name FROM value ORDER BY name");
    });
    for (const pqxx::row& row : names) value(row[0].as<std::string>());
  }

 private:
  void must_be_writer() const {
    if (access_ == MapAccess::kRead)
      throw UsageError(server_->name(), ": this map was opened for reading (MapAccess)");
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
  MapHead head_;
};

}  // namespace

std::unique_ptr<MapStore> open_postgres_map(const std::string& where, MapAccess access,
                                            const MapFingerprint* identity, DescriptorType format) {
  auto server = std::make_unique<Server>(postgres::parse_address(where));
  bool made = false;  // true also if the commit of a lost connection may have succeeded
  const MapHead head = server->run([&](pqxx::connection& connection) {
    pqxx::work step(connection);
    const auto is_there = [&] { return has_table(step, server->map(), "map"); };
    if (!is_there()) {
      if (identity == nullptr || access == MapAccess::kRead)
        throw InputError(
            str(server->name(), ": there is no map '", server->map(), "' in this database"));
      step.exec(
          str("SELECT pg_advisory_xact_lock(", kApplicationId, ")"));  // one process creates it
      if (!is_there()) {
        step.exec(str("CREATE SCHEMA IF NOT EXISTS ", server->map()));
        step.exec(kTables);
        step.exec(kTableOfRemoved);
        write_head(step, {.identity = *identity, .format = format});
        write_places(step, 0);
        made = true;
      }
    }
    if (access == MapAccess::kNew && !made) throw InputError(server->name(), ": already exists");
    // Without this privilege the server would report missing tables.
    if (!step.exec_params("SELECT has_schema_privilege($1, 'USAGE')", server->map())[0][0]
             .as<bool>())
      throw Error(server->name(), ": the server denies access: no right to use the schema ",
                  server->map(), "; grant it to this user, or use another");
    MapHead found = read_head(step, server->name());
    step.commit();
    return found;
  });
  return std::make_unique<PostgresMap>(std::move(server), access, head);
}

}  // namespace revisit
