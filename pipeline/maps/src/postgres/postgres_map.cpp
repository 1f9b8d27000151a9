#include "postgres_map.h"

#include <algorithm>
#include <set>

#include "revisit/base/error.h"
#include "server.h"
#include "tables.h"

namespace revisit {
namespace {

using Snapshot = pqxx::transaction<pqxx::repeatable_read, pqxx::read_only>;
using namespace postgres;

class PostgresMap : public MapStore {
 public:
  PostgresMap(std::unique_ptr<Server> server, MapAccess access, MapHeader header)
      : server_(std::move(server)), access_(access), header_(std::move(header)) {}

  const MapFingerprint& fingerprint() const override { return header_.fingerprint; }
  DescriptorType descriptor_type() const override { return header_.format; }

  int64_t size() const override {
    return server_->run([&](pqxx::connection& connection) {
      Snapshot snapshot(connection);
      return std::max<int64_t>(0,
                               read_count(snapshot, server_->name()) - count_removed(snapshot, 0));
    });
  }

  std::optional<int64_t> dimensions() const override {
    return server_->run([&](pqxx::connection& connection) -> std::optional<int64_t> {
      Snapshot snapshot(connection);
      const pqxx::result rows = snapshot.exec("SELECT length(descriptor) FROM entry LIMIT 1");
      if (rows.empty()) return std::nullopt;
      return rows[0][0].as<int64_t>() / revisit::bytes_of(header_.format);
    });
  }

  std::optional<std::string> value(const std::string& name) const override {
    return server_->run([&](pqxx::connection& connection) -> std::optional<std::string> {
      Snapshot snapshot(connection);
      const pqxx::result rows =
          snapshot.exec_params("SELECT bytes, checksum FROM value WHERE name = $1", name);
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
      lock_entries(step, server_->name());
      put_value(step, name, bytes);
      server_->notify_others(step);
      step.commit();
    });
  }

  std::vector<int64_t> add(std::span<const MapEntry> entries,
                           std::optional<int64_t> revision) override {
    must_be_writer();
    const NewEntries all(entries, header_.format);
    if (entries.empty()) return {};
    int64_t first = 0;  // first id of the previous attempt
    return server_->run([&](pqxx::connection& connection) {
      std::vector<int64_t> ids;
      pqxx::work step(connection);
      const int64_t there = lock_entries(step, server_->name());
      // After a lost commit the outcome is unknown; look for the row with this call id.
      const bool was_added =
          first > 0 &&
          !step.exec_params("SELECT 1 FROM entry WHERE id = $1 AND call = $2", first, all.call)
               .empty();
      if (!was_added) {
        const MapHeader header = read_header(step, server_->name());
        if (revision && *revision != header.revision) return ids;
        first = insert_entries(step, all, there, header);
        server_->notify_others(step);
        step.commit();
      }
      for (size_t i = 0; i < entries.size(); ++i) ids.push_back(first + static_cast<int64_t>(i));
      return ids;
    });
  }

  MapState read(int64_t after, const Take& take, const Warn& warn) const override {
    MapState at{.last = std::max<int64_t>(after, 0), .revision = -1};
    server_->clear_updates();  // before the snapshot: later changes send another notification
    server_->run([&](pqxx::connection& connection) {
      connection.get_notifs();
      server_->clear_updates();
      Snapshot snapshot(connection);
      const MapHeader header = read_header(snapshot, server_->name());
      const int64_t there = read_count(snapshot, server_->name());
      // A lost connection began another snapshot, with other descriptors: the next read() resumes.
      if (at.revision >= 0 && at.revision != header.revision) return server_->keep_updates();
      // From the first snapshot, because entries removed later may already have been passed on.
      if (at.revision < 0) at.removed = last_removal(snapshot);
      at.revision = header.revision;
      at.last = std::min(at.last, there);
      const int64_t behind = at.last, expected = there - behind - count_removed(snapshot, behind);
      const int64_t found = select_entries(
          snapshot, header, there, at.last,
          [&](MapEntry&& entry, int64_t) { take(std::move(entry)); },
          [&](int64_t id, const std::string& defect) {
            warn(str(server_->name(), ": entry ", id, " is corrupt: ", defect));
          });
      if (found != expected)
        warn(str(server_->name(), ": it has ", found, " entries after entry ", behind,
                 ", expected ", expected, "; restore a copy"));
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

  bool replace_descriptors(const std::function<std::vector<float>(const MapEntry&)>& descriptor_of,
                           const std::map<std::string, std::string>& values,
                           int64_t revision) override {
    must_be_writer();
    return server_->run([&](pqxx::connection& connection) {
      pqxx::work step(connection);
      const int64_t there = lock_entries(step, server_->name());
      MapHeader header = read_header(step, server_->name());
      if (header.revision != revision) return false;
      int64_t last = 0;
      select_entries(
          step, header, there, last,
          [&](MapEntry&& entry, int64_t call) {
            entry.descriptor = descriptor_of(entry);
            entry.feature.clear();
            write_entry(step, kReplaceEntryAt, entry.id, entry,
                        entry_row(entry, header.format, entry.id), revision + 1, call);
          },
          [](int64_t, const std::string&) {});
      ++header.revision;
      write_header(step, header);
      for (const auto& [name, bytes] : values) put_value(step, name, bytes);
      server_->notify_others(step);
      step.commit();
      return true;
    });
  }

  std::string cloud(int64_t id) const override {
    return server_->run([&](pqxx::connection& connection) -> std::string {
      Snapshot snapshot(connection);
      const pqxx::result rows =
          snapshot.exec_params("SELECT bytes, checksum FROM cloud WHERE id = $1", id);
      if (rows.empty()) return "";
      std::string bytes = bytes_in(rows[0][0]);
      if (cloud_checksum(id, bytes) != rows[0][1].as<int64_t>())
        throw InputError(server_->name(), ": the points of entry ", id,
                         " are corrupt: their checksum is wrong");
      return bytes;
    });
  }

  int64_t remove(std::span<const int64_t> ids) override {
    must_be_writer();
    std::set<int64_t> to_remove;  // ids of the first attempt
    return server_->run([&](pqxx::connection& connection) {
      pqxx::work step(connection);
      const int64_t there = lock_entries(step, server_->name());
      std::set<int64_t> left = ids_to_remove(ids, there);
      for (const int64_t id : read_removed(step, server_->name(), 0)) left.erase(id);
      if (to_remove.empty()) to_remove = left;
      if (!left.empty()) {
        remove_entries(step, left);
        server_->notify_others(step);
        step.commit();
      }
      return static_cast<int64_t>(to_remove.size());
    });
  }

  std::vector<int64_t> removed(int64_t after) const override {
    return server_->run([&](pqxx::connection& connection) {
      Snapshot snapshot(connection);
      return read_removed(snapshot, server_->name(), after);
    });
  }

  void check(const Warn& report) const override {
    read(
        0, [](MapEntry&&) {}, report);
    removed(0);
    const auto all = [&](const char* sql) {
      return server_->run([&](pqxx::connection& connection) {
        Snapshot snapshot(connection);
        return snapshot.exec(sql);
      });
    };
    for (const pqxx::row& row : all("SELECT name FROM value ORDER BY name"))
      value(row[0].as<std::string>());
    for (const pqxx::row& row : all("SELECT id FROM cloud ORDER BY id"))
      cloud(row[0].as<int64_t>());
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
  MapHeader header_;
};

}  // namespace

std::unique_ptr<MapStore> open_postgres_map(const std::string& where, MapAccess access,
                                            const MapFingerprint* fingerprint,
                                            DescriptorType format) {
  auto server = std::make_unique<Server>(postgres::parse_address(where));
  bool made = false;  // true also if the commit of a lost connection may have succeeded
  const MapHeader header = server->run([&](pqxx::connection& connection) {
    pqxx::work step(connection);
    const auto is_there = [&] { return has_table(step, server->map(), "map"); };
    if (!is_there()) {
      if (fingerprint == nullptr || access == MapAccess::kRead)
        throw InputError(
            str(server->name(), ": there is no map '", server->map(), "' in this database"));
      step.exec(
          str("SELECT pg_advisory_xact_lock(", kApplicationId, ")"));  // one process creates it
      if (!is_there()) {
        step.exec(str("CREATE SCHEMA IF NOT EXISTS ", server->map()));
        step.exec(kTables);
        write_header(step, {.fingerprint = *fingerprint, .format = format});
        write_count(step, 0);
        made = true;
      }
    }
    if (access == MapAccess::kNew && !made) throw InputError(server->name(), ": already exists");
    // Without this privilege the server would report missing tables.
    if (!step.exec_params("SELECT has_schema_privilege($1, 'USAGE')", server->map())[0][0]
             .as<bool>())
      throw Error(server->name(), ": the server denies access: no right to use the schema ",
                  server->map(), "; grant it to this user, or use another");
    MapHeader found = read_header(step, server->name());
    step.commit();
    return found;
  });
  return std::make_unique<PostgresMap>(std::move(server), access, header);
}

}  // namespace revisit
