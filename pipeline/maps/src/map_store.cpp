#include "revisit/maps/map_store.h"

#include <algorithm>
#include <set>

#include "map_tables.h"
#include "revisit/base/error.h"
#include "sql_driver.h"

namespace revisit {

MapStore::MapStore(std::unique_ptr<SqlDriver> driver, MapAccess access)
    : driver_(std::move(driver)), access_(access) {
  MapHeader header = driver_->run(Locking::kReads, [&] { return read_header(*driver_); });
  fingerprint_ = std::move(header.fingerprint);
  descriptor_type_ = header.format;
}

MapStore::~MapStore() = default;

void MapStore::must_be_writer() const {
  if (access_ == MapAccess::kRead)
    throw UsageError(driver_->name(), ": this map was opened for reading (MapAccess)");
}

int64_t MapStore::size() const {
  return driver_->run(Locking::kReads, [&] {
    return std::max<int64_t>(0, read_counts(*driver_).entries - count_removed(*driver_, 0));
  });
}

std::optional<int64_t> MapStore::dimensions() const {
  return driver_->run(Locking::kReads, [&]() -> std::optional<int64_t> {
    const auto bytes = driver_->integer("SELECT length(descriptor) FROM entry LIMIT 1");
    if (!bytes) return std::nullopt;
    return *bytes / bytes_of(descriptor_type_);
  });
}

std::optional<std::string> MapStore::value(const std::string& name) const {
  return driver_->run(Locking::kReads, [&] { return read_value(*driver_, name); });
}

void MapStore::set_value(const std::string& name, const std::string& bytes) {
  must_be_writer();
  driver_->transaction(Locking::kWrites, [&] {
    lock_counts(*driver_);
    write_value(*driver_, name, bytes);
    driver_->notify();
  });
}

std::vector<int64_t> MapStore::add(std::span<const MapEntry> entries,
                                   std::optional<int64_t> revision) {
  must_be_writer();
  std::vector<EntryRow> rows;
  for (const MapEntry& entry : entries)
    rows.push_back(entry_row(entry, descriptor_type_, rows.size() + 1));
  if (entries.empty()) return {};
  return driver_->run(Locking::kWrites, [&] {
    std::vector<int64_t> ids;
    Counts counts = lock_counts(*driver_);
    const int64_t current = read_header(*driver_).revision;
    if (revision && *revision != current) return ids;
    for (size_t i = 0; i < rows.size(); ++i) {
      ids.push_back(++counts.entries);
      write_entry(*driver_, kInsertEntry, ids.back(), rows[i], current);
      if (!entries[i].cloud.empty()) write_cloud(*driver_, ids.back(), entries[i].cloud);
    }
    write_counts(*driver_, counts);
    driver_->notify();
    return ids;
  });
}

MapState MapStore::read(int64_t after, const Take& take, const Warn& warn) const {
  MapState at{.last = std::max<int64_t>(after, 0), .revision = -1};
  const std::string& name = driver_->name();
  driver_->transaction(Locking::kReads, [&] {
    driver_->updates = false;  // before the snapshot: later changes send another notification
    const MapHeader header = read_header(*driver_);
    const int64_t last = read_counts(*driver_).entries;
    // A lost connection began another snapshot, with other descriptors: the next read() resumes.
    if (at.revision >= 0 && at.revision != header.revision) {
      driver_->updates = true;
      return;
    }
    // From the first snapshot, because entries removed later may already have been passed on.
    if (at.revision < 0)
      at.removed = driver_->integer("SELECT coalesce(max(id), 0) FROM removed").value_or(0);
    at.revision = header.revision;
    at.last = std::min(at.last, last);
    const int64_t before = at.last, expected = last - before - count_removed(*driver_, before);
    const int64_t found = for_each_entry(
        *driver_, header, at.last, last, take, [&](int64_t id, const std::string& problem) {
          warn(str(name, ": entry ", id, " is corrupt: ", problem));
        });
    if (found != expected)
      warn(str(name, ": it has ", found, " entries after entry ", before, ", expected ", expected,
               "; restore a copy"));
  });
  return at;
}

std::string MapStore::cloud(int64_t id) const {
  return driver_->run(Locking::kReads, [&] { return read_cloud(*driver_, id); });
}

int64_t MapStore::remove(std::span<const int64_t> ids) {
  must_be_writer();
  return driver_->run(Locking::kWrites, [&] {
    std::set<int64_t> to_remove = ids_to_remove(ids, lock_counts(*driver_).entries);
    for (const int64_t id : read_removed(*driver_, 0)) to_remove.erase(id);
    for (const int64_t id : to_remove) {
      for (const char* table : {"entry", "cloud"})
        driver_->execute(str("DELETE FROM ", table, " WHERE id = $1"), {id});
      write_removed(*driver_, id);
    }
    if (!to_remove.empty()) driver_->notify();
    return std::ssize(to_remove);
  });
}

std::vector<int64_t> MapStore::removed(int64_t after) const {
  return driver_->run(Locking::kReads, [&] { return read_removed(*driver_, after); });
}

bool MapStore::reserve_drive(const std::string& drive, const std::string& content) {
  if (!driver_->is_shared()) return true;
  must_be_writer();
  check_drive(drive);
  return driver_->run(Locking::kWrites, [&] {
    const std::string name = kRecordingOf + drive;
    lock_counts(*driver_);
    const auto found = read_value(*driver_, name);
    if (!found) write_value(*driver_, name, content);
    return !found || *found == content;
  });
}

bool MapStore::has_updates() {
  return driver_->has_updates();
}

void MapStore::check(const Warn& report) const {
  read(
      0, [](MapEntry&&) {}, report);
  driver_->transaction(Locking::kReads, [&] {
    check_values(*driver_);
    read_removed(*driver_, 0);
    driver_->execute("SELECT id FROM cloud ORDER BY id", {},
                     [&](const SqlRow& row) { read_cloud(*driver_, row.integer(0)); });
    if (driver_->dialect.integrity_check == nullptr) return;
    driver_->execute(driver_->dialect.integrity_check, {}, [&](const SqlRow& row) {
      if (row.bytes(0) != "ok") report(str(driver_->name(), ": ", row.bytes(0)));
    });
  });
}

bool MapStore::replace_descriptors(
    const std::function<std::vector<float>(const MapEntry&)>& descriptor_of,
    const std::map<std::string, std::string>& values, int64_t revision) {
  must_be_writer();
  return driver_->run(Locking::kWrites, [&] {
    const int64_t last = lock_counts(*driver_).entries;
    MapHeader header = read_header(*driver_);
    if (header.revision != revision) return false;
    int64_t after = 0;
    const auto replace = [&](MapEntry&& entry) {
      entry.descriptor = descriptor_of(entry);
      entry.feature.clear();
      write_entry(*driver_, kReplaceEntry, entry.id,
                  entry_row(entry, header.format, static_cast<size_t>(entry.id)), revision + 1);
    };
    for_each_entry(*driver_, header, after, last, replace, [](int64_t, const std::string&) {});
    ++header.revision;
    write_header(*driver_, header);
    for (const auto& [name, bytes] : values) write_value(*driver_, name, bytes);
    driver_->notify();
    return true;
  });
}

}  // namespace revisit
