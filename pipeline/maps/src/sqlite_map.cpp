#include <algorithm>
#include <functional>
#include <map>
#include <set>

#include "revisit/base/error.h"
#include "sqlite_tables.h"

namespace revisit {
namespace {

using sqlite::Locking;
using sqlite::Statement;
using sqlite::Transaction;

int64_t value_checksum(int64_t id, std::string_view name, std::string_view bytes) {
  return Checksum().number(id).bytes(name).bytes(bytes).value();
}

/// Entries with ids in (`after`, `last`]. `take` may modify them; `report` gets id and problem of
/// each corrupt one. Returns the number of rows.
template <class Take, class Report>
int64_t for_each_entry(sqlite::Connection& connection, const MapHeader& header, int64_t after,
                       int64_t last, const Take& take, const Report& report) {
  Statement select(connection, kSelectEntries);
  select.bind(1, after).bind(2, last);
  int64_t n = 0;
  for (; select.step(); ++n) {
    const int64_t id = select.integer(0);
    if (id <= after) connection.fail_corrupt(str("entry ", id, " is out of order"));
    after = id;
    MapEntry entry;
    const std::string defect = take_row(select, header, entry);
    if (defect.empty())
      take(std::move(entry));
    else
      report(id, defect);
  }
  return n;
}

class SqliteMap : public MapStore {
 public:
  /// `lock`: null for a reader.
  SqliteMap(std::unique_ptr<WriterLock> lock, std::unique_ptr<sqlite::Connection> connection)
      : lock_(std::move(lock)),
        connection_(std::move(connection)),
        header_(read_header(*connection_)) {}

  ~SqliteMap() override {
    // Then the file has all entries, also if readers keep the log.
    if (lock_ != nullptr)
      sqlite3_wal_checkpoint_v2(connection_->handle(), nullptr, SQLITE_CHECKPOINT_PASSIVE, nullptr,
                                nullptr);
  }

  const MapFingerprint& fingerprint() const override { return header_.fingerprint; }
  DescriptorType descriptor_type() const override { return header_.format; }

  int64_t size() const override {
    const Transaction snapshot(*connection_, Locking::kReads);
    return std::max<int64_t>(0, read_counts(*connection_).entries - count_removed(*connection_, 0));
  }

  std::optional<int64_t> dimensions() const override {
    const Transaction snapshot(*connection_, Locking::kReads);
    Statement select(*connection_, "SELECT length(descriptor) FROM entry LIMIT 1");
    if (!select.step()) return std::nullopt;
    return select.integer(0) / bytes_of(header_.format);
  }

  std::optional<std::string> value(const std::string& name) const override {
    const Transaction snapshot(*connection_, Locking::kReads);
    auto values = read_values();
    const auto found = values.find(name);
    if (found == values.end()) return std::nullopt;
    fail_unless_valid(found->second);
    return std::move(found->second.bytes);
  }

  void set_value(const std::string& name, const std::string& bytes) override {
    must_be_writer();
    Transaction step(*connection_, Locking::kWrites);
    put_value(name, bytes);
    step.commit();
  }

  std::vector<int64_t> add(std::span<const MapEntry> entries,
                           std::optional<int64_t> expected) override {
    must_be_writer();
    std::vector<int64_t> ids;
    if (entries.empty()) return ids;
    Transaction step(*connection_, Locking::kWrites);
    Counts counts = read_counts(*connection_);
    const int64_t revision = read_header(*connection_).revision;
    if (expected && *expected != revision) return ids;
    {
      Statement insert(*connection_, kInsertEntry);
      for (const MapEntry& entry : entries) {
        const EntryRow row = entry_row(entry, header_.format, ids.size() + 1);
        ids.push_back(++counts.entries);
        write_entry(insert, ids.back(), entry, row, revision);
        if (!entry.cloud.empty()) write_cloud(*connection_, ids.back(), entry.cloud);
      }
    }
    write_counts(*connection_, counts);
    step.commit();
    return ids;
  }

  MapState read(int64_t after, const Take& take, const Warn& warn) const override {
    const std::string& file = connection_->name();
    const Transaction snapshot(*connection_, Locking::kReads);
    const MapHeader header = read_header(*connection_);
    const int64_t last = read_counts(*connection_).entries;
    after = std::clamp<int64_t>(after, 0, last);
    const int64_t expected = last - after - count_removed(*connection_, after);
    const int64_t found = for_each_entry(*connection_, header, after, last, take,
                                         [&](int64_t id, const std::string& defect) {
                                           warn(str(file, ": entry ", id, " is corrupt: ", defect));
                                         });
    if (found != expected)
      warn(str(file, ": it has ", found, " entries after entry ", after, ", expected ", expected,
               "; restore a copy"));
    return {.last = last, .revision = header.revision, .removed = last_removal(*connection_)};
  }

  bool replace_descriptors(const std::function<std::vector<float>(const MapEntry&)>& descriptor_of,
                           const std::map<std::string, std::string>& values,
                           int64_t revision) override {
    must_be_writer();
    Transaction step(*connection_, Locking::kWrites);
    MapHeader header = read_header(*connection_);
    if (header.revision != revision) return false;
    {
      Statement replace(*connection_, kReplaceEntry);
      for_each_entry(
          *connection_, header, 0, read_counts(*connection_).entries,
          [&](MapEntry&& entry) {
            entry.descriptor = descriptor_of(entry);
            entry.feature.clear();
            write_entry(replace, entry.id, entry, entry_row(entry, header.format, entry.id),
                        header.revision + 1);
          },
          [](int64_t, const std::string&) {});
    }
    ++header.revision;
    write_header(*connection_, header);
    for (const auto& [name, bytes] : values) put_value(name, bytes);
    step.commit();
    return true;
  }

  std::string cloud(int64_t id) const override {
    const Transaction snapshot(*connection_, Locking::kReads);
    return read_cloud(*connection_, id);
  }

  int64_t remove(std::span<const int64_t> ids) override {
    must_be_writer();
    Transaction step(*connection_, Locking::kWrites);
    std::set<int64_t> to_remove = ids_to_remove(ids, read_counts(*connection_).entries);
    for (const int64_t id : read_removed(*connection_, 0)) to_remove.erase(id);
    if (to_remove.empty()) return 0;
    for (const char* sql : {"DELETE FROM entry WHERE id = ?", "DELETE FROM cloud WHERE id = ?"}) {
      Statement remove(*connection_, sql);
      for (const int64_t id : to_remove) remove.reset().bind(1, id).step();
    }
    write_removed(*connection_, std::vector<int64_t>(to_remove.begin(), to_remove.end()));
    step.commit();
    return static_cast<int64_t>(to_remove.size());
  }

  std::vector<int64_t> removed(int64_t after) const override {
    const Transaction snapshot(*connection_, Locking::kReads);
    return read_removed(*connection_, after);
  }

  void check(const Warn& report) const override {
    read(
        0, [](MapEntry&&) {}, report);
    const Transaction snapshot(*connection_, Locking::kReads);
    for (const auto& [name, value] : read_values()) fail_unless_valid(value);
    read_removed(*connection_, 0);
    Statement select(*connection_, "SELECT id FROM cloud");
    while (select.step()) read_cloud(*connection_, select.integer(0));
    // Beyond the content of the tables: free pages and inner pages of the trees.
    Statement integrity(*connection_, "PRAGMA integrity_check(20)");
    while (integrity.step())
      if (integrity.bytes(0) != "ok") report(str(connection_->name(), ": ", integrity.bytes(0)));
  }

 private:
  struct Value {
    int64_t id;
    std::string bytes;
    bool valid = true;
  };

  void must_be_writer() const {
    if (lock_ == nullptr)
      throw UsageError(connection_->name(), ": this map was opened for reading (MapAccess)");
  }

  /// Must run in a transaction. Throws InputError if a value that a map needs is corrupt.
  std::map<std::string, Value> read_values() const {
    std::map<std::string, Value> values;
    int64_t n_rows = 0;
    Statement select(*connection_, "SELECT id, name, bytes, checksum FROM value");
    for (; select.step(); ++n_rows) {
      Value value{select.integer(0), std::string(select.bytes(2))};
      std::string name(select.bytes(1));
      value.valid = value_checksum(value.id, name, value.bytes) == select.integer(3);
      if (std::ranges::find(kAcceptanceValues, name) == kAcceptanceValues.end())
        fail_unless_valid(value);
      values.emplace(std::move(name), std::move(value));
    }
    if (const int64_t n = read_counts(*connection_).values; n_rows != n)
      connection_->fail_corrupt(str("it has ", n_rows, " values beside its entries, expected ", n));
    return values;
  }

  void fail_unless_valid(const Value& value) const {
    if (!value.valid)
      connection_->fail_corrupt(str("the checksum of value ", value.id, " is wrong"));
  }

  void put_value(const std::string& name, const std::string& bytes) {
    if (name.size() + bytes.size() > kMaxBytes - 1000)
      throw UsageError(
          str("value '", name, "' has ", bytes.size(), " bytes, more than the limit of 256 MB"));
    const auto values = read_values();
    const auto found = values.find(name);
    const int64_t id = found == values.end() ? std::ssize(values) + 1 : found->second.id;
    Statement(*connection_,
              "INSERT OR REPLACE INTO value (id, name, bytes, checksum) VALUES (?, ?, ?, ?)")
        .bind(1, id)
        .bind(2, std::string_view(name))
        .bind_blob(3, bytes)
        .bind(4, value_checksum(id, name, bytes))
        .step();
    if (found != values.end()) return;
    Counts counts = read_counts(*connection_);
    ++counts.values;
    write_counts(*connection_, counts);
  }

  std::unique_ptr<WriterLock> lock_;  // released after the connection
  std::unique_ptr<sqlite::Connection> connection_;
  MapHeader header_;
};

}  // namespace

std::unique_ptr<MapStore> make_sqlite_map(std::unique_ptr<WriterLock> lock,
                                          std::unique_ptr<sqlite::Connection> connection) {
  return std::make_unique<SqliteMap>(std::move(lock), std::move(connection));
}

}  // namespace revisit
