#include "revisit/maps/map_store.h"

#include <algorithm>
#include <set>

#include "map_format.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit {
namespace {

constexpr int64_t kMaxRows = int64_t{1} << 48;  // limit for any map: larger ids may overflow
constexpr int64_t kEntriesAtOnce = 256;
/// Prefix of the names of values that reserve_drive() stores.
constexpr const char* kRecordingOf = "recording of ";

/// A corrupt name may be NULL or a blob in a file.
constexpr const char* kNameOfValue = "coalesce(CAST(name AS TEXT), '')";

/// Appends their checksum to the values.
void write_row(SqlDriver& driver, const std::string& sql, std::vector<SqlValue> values) {
  values.emplace_back(checksum_of(values));
  driver.execute(sql, values);
}

/// The last column must be the checksum of the others. `of`: for the error.
void read_rows(SqlDriver& driver, const std::string& sql, const std::vector<SqlValue>& values,
               const std::string& of, const SqlDriver::Take& take) {
  driver.execute(sql, values, [&](const SqlRow& row) {
    const size_t last = row.cells.size() - 1;
    if (checksum_of(std::span(row.cells).first(last)) != row.integer(last))
      driver.fail_corrupt("the checksum of " + of + " is wrong");
    take(row);
  });
}

/// `lock`: SqlDialect::for_update before a change. Ids are then assigned in the order of commits:
/// with a sequence, a reader that has seen id 7 could miss a 6 that is committed later.
Counts read_counts(SqlDriver& driver, const char* lock = "") {
  std::optional<Counts> counts;
  read_rows(driver, str("SELECT entries, \"values\", checksum FROM counts WHERE id = 1", lock), {},
            "the number of its entries", [&](const SqlRow& row) {
              counts = {row.integer(0), row.integer(1)};
            });
  if (!counts) driver.fail_corrupt("the number of its entries is missing");
  for (const int64_t n : {counts->entries, counts->values})
    if (n < 0 || n > kMaxRows) driver.fail_corrupt(str("it cannot have ", n, " entries or values"));
  return *counts;
}

Counts lock_counts(SqlDriver& driver) {
  return read_counts(driver, driver.dialect.for_update);
}

MapHeader read_header(SqlDriver& driver) {
  std::optional<MapHeader> header;
  read_rows(driver, "SELECT fingerprint, dtype, revision, checksum FROM map WHERE id = 1", {},
            "its header", [&](const SqlRow& row) {
              const auto format = descriptor_type_of(row.bytes(1));
              if (!format) driver.fail_corrupt("the data type of its descriptors is unknown");
              header = {fingerprint_from(row.bytes(0)), *format, row.integer(2)};
            });
  if (!header) driver.fail_corrupt("its header is missing");
  return *std::move(header);
}

/// Passes entries with ids in (`after`, `last`] to `take` and advances `after`; passes id and
/// problem of each corrupt one to `report`. Returns the number of rows.
int64_t for_each_entry(SqlDriver& driver, const MapHeader& header, int64_t& after, int64_t last,
                       const std::function<void(MapEntry&&)>& take,
                       const std::function<void(int64_t, const std::string&)>& report) {
  int64_t n = 0, rows = 0;
  do {
    rows = 0;
    driver.execute(
        "SELECT id, drive, frame, time, pose, descriptor, feature, revision, loops, checksum FROM "
        "entry "
        "WHERE id > $1 AND id <= $2 ORDER BY id LIMIT $3",
        {after, last, kEntriesAtOnce}, [&](const SqlRow& row) {
          const int64_t id = row.integer(0);
          if (id <= after) driver.fail_corrupt(str("entry ", id, " is out of order"));
          after = id;
          ++rows;
          MapEntry entry;
          const std::string problem = read_entry(row, header, entry);
          if (problem.empty())
            take(std::move(entry));
          else
            report(id, problem);
        });
    n += rows;
  } while (rows == kEntriesAtOnce);
  after = last;
  return n;
}

int64_t count_removed(SqlDriver& driver, int64_t after) {
  return driver.integer("SELECT count(*) FROM removed WHERE entry > $1", {after}).value_or(0);
}

/// Ids in the order of removal, without the first `after`.
std::vector<int64_t> read_removed(SqlDriver& driver, int64_t after) {
  std::vector<int64_t> entries;
  read_rows(driver, "SELECT id, entry, checksum FROM removed WHERE id > $1 ORDER BY id", {after},
            "a removed entry", [&](const SqlRow& row) { entries.push_back(row.integer(1)); });
  return entries;
}

std::string read_cloud(SqlDriver& driver, int64_t id) {
  std::string bytes;
  read_rows(driver, "SELECT id, bytes, checksum FROM cloud WHERE id = $1", {id},
            str("the points of entry ", id), [&](const SqlRow& row) { bytes = row.bytes(1); });
  return bytes;
}

/// Verifies the values that `where` selects, and the number of all. Returns the bytes of the last.
std::optional<std::string> read_values(SqlDriver& driver, const std::string& where,
                                       const std::vector<SqlValue>& parameters = {}) {
  const int64_t n = driver.integer("SELECT count(*) FROM value").value_or(0),
                expected = read_counts(driver).values;
  if (n != expected)
    driver.fail_corrupt(str("it has ", n, " values beside its entries, expected ", expected));
  std::optional<std::string> found;
  read_rows(driver, "SELECT id, name, bytes, checksum FROM value " + where, parameters, "a value",
            [&](const SqlRow& row) { found = row.bytes(2); });
  return found;
}

std::optional<std::string> read_value(SqlDriver& driver, const std::string& name) {
  auto bytes = read_values(driver, str("WHERE ", kNameOfValue, " = $1"), {name});
  // A corrupt byte may have changed the name. The usual values have theirs, and may be large.
  if (!bytes)
    read_values(driver, str("WHERE ", kNameOfValue, " NOT IN ('", kProjectionValue, "', '",
                            kCalibrationValue, "', '", kVerifiedCalibrationValue, "') AND ",
                            kNameOfValue, " NOT LIKE '", kRecordingOf, "%'"));
  return bytes;
}

/// Call lock_counts() before. Throws UsageError for more than 256 MB.
void write_value(SqlDriver& driver, const std::string& name, const std::string& bytes) {
  if (name.size() + bytes.size() > kMaxBytes - 1000)
    throw UsageError("value '", name, "' has ", bytes.size(),
                     " bytes, more than the limit of 256 MB");
  read_values(driver, "LIMIT 0");  // their number
  Counts counts = read_counts(driver);
  auto id = driver.integer(str("SELECT id FROM value WHERE ", kNameOfValue, " = $1"), {name});
  if (!id) {
    id = ++counts.values;
    write_counts(driver, counts);
  }
  write_row(driver,
            "INSERT INTO value (id, name, bytes, checksum) VALUES ($1, $2, $3, $4) ON CONFLICT "
            "(id) DO UPDATE SET name = excluded.name, bytes = excluded.bytes, checksum = "
            "excluded.checksum",
            {*id, name, Blob{bytes}});
}

}  // namespace

std::vector<std::string> table_definitions(const SqlDialect& dialect) {
  const std::string id = str(" (id ", dialect.id), integer = str(" ", dialect.integer),
                    blob = str(" ", dialect.blob), real = str(" ", dialect.real),
                    checksum = str(", checksum", integer, ")");
  return {
      "CREATE TABLE map" + id + ", fingerprint TEXT, dtype TEXT, revision" + integer + checksum,
      "CREATE TABLE counts" + id + ", entries" + integer + ", \"values\"" + integer + checksum,
      "CREATE TABLE value" + id + ", name TEXT, bytes" + blob + checksum,
      "CREATE TABLE entry" + id + ", drive TEXT, frame" + integer + ", time" + real + ", pose" +
          blob + ", descriptor" + blob + ", feature" + blob + ", revision" + integer + ", loops" +
          blob + checksum,
      "CREATE TABLE removed" + id + ", entry" + integer + checksum,
      "CREATE TABLE cloud" + id + ", bytes" + blob + checksum,
  };
}

void create_tables(SqlDriver& driver, const MapHeader& header) {
  for (const std::string& table : table_definitions(driver.dialect)) driver.execute(table);
  write_header(driver, header);
  write_counts(driver, {});
}

void write_header(SqlDriver& driver, const MapHeader& header) {
  const std::string text = text_of(header.fingerprint), dtype = name_of(header.format);
  write_row(driver,
            "INSERT INTO map (id, fingerprint, dtype, revision, checksum) VALUES (1, $1, $2, $3, "
            "$4) ON CONFLICT (id) DO UPDATE SET fingerprint = excluded.fingerprint, dtype = "
            "excluded.dtype, revision = excluded.revision, checksum = excluded.checksum",
            {text, dtype, header.revision});
}

void write_counts(SqlDriver& driver, const Counts& counts) {
  write_row(driver,
            "INSERT INTO counts (id, entries, \"values\", checksum) VALUES (1, $1, $2, $3) ON "
            "CONFLICT (id) DO UPDATE SET entries = excluded.entries, \"values\" = "
            "excluded.\"values\", checksum = excluded.checksum",
            {counts.entries, counts.values});
}

void insert_entries(SqlDriver& driver, std::span<const std::vector<SqlValue>> rows) {
  constexpr size_t kRowsAtOnce = 50, kBytesAtOnce = 1 << 20;
  while (!rows.empty()) {
    std::string sql =
        "INSERT INTO entry (id, drive, frame, time, pose, descriptor, feature, revision, loops, "
        "checksum) "
        "VALUES ";
    std::vector<SqlValue> values;
    size_t n = 0, bytes = 0;
    for (; n < std::min(rows.size(), kRowsAtOnce) && bytes < kBytesAtOnce; ++n) {
      const size_t before = values.size();
      values.insert(values.end(), rows[n].begin(), rows[n].end());
      values.emplace_back(checksum_of(rows[n]));
      for (size_t i = before; i < values.size(); ++i)
        sql += str(i > before ? ", $" : before > 0 ? ", ($" : "($", i + 1);
      sql += ")";
      for (const SqlValue& value : rows[n])
        if (const auto* blob = std::get_if<Blob>(&value)) bytes += blob->bytes.size();
    }
    driver.execute(sql, values);
    rows = rows.subspan(n);
  }
}

void write_removed(SqlDriver& driver, int64_t entry) {
  // The database computes the id: it fails after the largest number.
  const auto id = driver.integer("SELECT coalesce(max(id), 0) + 1 FROM removed");
  write_row(driver, "INSERT INTO removed (id, entry, checksum) VALUES ($1, $2, $3)", {*id, entry});
}

MapStore::MapStore(std::unique_ptr<SqlDriver> driver, MapAccess access)
    : driver_(std::move(driver)), access_(access) {
  MapHeader header = driver_->run(Locking::kReads, [&] { return read_header(*driver_); });
  fingerprint_ = std::move(header.fingerprint);
  descriptor_type_ = header.format;
  driver_->has_updates();  // SQLite counts changes from the first call
}

MapStore::~MapStore() = default;

void MapStore::must_be_writer() const {
  if (access_ == MapAccess::kRead)
    throw UsageError(driver_->name(), ": this map was opened for reading (MapAccess)");
}

const std::string& MapStore::name() const {
  return driver_->name();
}

int64_t MapStore::size() const {
  return driver_->run(Locking::kReads, [&] {
    return std::max<int64_t>(0, read_counts(*driver_).entries - count_removed(*driver_, 0));
  });
}

std::optional<int64_t> MapStore::dimensions() const {
  return driver_->run(Locking::kReads, [&]() -> std::optional<int64_t> {
    const auto bytes = driver_->integer(
        "SELECT length(descriptor) FROM entry WHERE length(descriptor) > 0 GROUP BY "
        "length(descriptor) ORDER BY count(*) DESC LIMIT 1");
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
  std::vector<EntryBytes> bytes;
  for (const MapEntry& entry : entries)
    bytes.push_back(encoded(entry, descriptor_type_, bytes.size() + 1));
  if (entries.empty()) return {};
  return driver_->run(Locking::kWrites, [&] {
    std::vector<int64_t> ids;
    Counts counts = lock_counts(*driver_);
    const MapHeader header = read_header(*driver_);
    if (header.fingerprint != fingerprint_)
      throw InputError(driver_->name(), ": another map has replaced this one; open it again");
    const int64_t current = header.revision;
    if (revision && *revision != current) return ids;
    if (claimed_on_ && *claimed_on_ != driver_->connections)
      throw ClaimLost(driver_->name(),
                      ": the connection was lost; claimed scans can be claimed again");
    std::vector<std::vector<SqlValue>> rows;
    for (size_t i = 0; i < entries.size(); ++i) {
      ids.push_back(++counts.entries);
      rows.push_back(entry_columns(ids.back(), entries[i], bytes[i], current));
      if (!entries[i].cloud.empty())
        write_row(*driver_, "INSERT INTO cloud (id, bytes, checksum) VALUES ($1, $2, $3)",
                  {ids.back(), Blob{entries[i].cloud}});
    }
    insert_entries(*driver_, rows);
    write_counts(*driver_, counts);
    driver_->notify();
    return ids;
  });
}

MapState MapStore::read(int64_t after, const Take& take, const Warn& warn) const {
  MapState at{.last = std::max<int64_t>(after, 0), .revision = -1};
  const std::string& name = driver_->name();
  driver_->has_updates();  // those so far
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

std::vector<int64_t> MapStore::claim(const std::string& drive, std::span<const int64_t> frames,
                                     int64_t most) {
  must_be_writer();
  check_drive(drive);
  if (most < 1) throw UsageError("a claim of ", most, " scans: expected at least 1");
  std::vector<int64_t> claimed(frames.begin(), frames.end());
  if (driver_->dialect.claim == nullptr) {
    claimed.resize(std::min(claimed.size(), static_cast<size_t>(most)));
    return claimed;
  }
  const std::string wanted = "{" + joined(frames, ",") + "}";
  driver_->transaction(Locking::kReads, [&] {
    claimed.clear();
    driver_->execute(driver_->dialect.end_claims);
    driver_->execute(driver_->dialect.claim, {wanted, drive, most},
                     [&](const SqlRow& row) { claimed.push_back(row.integer(0)); });
    claimed_on_ = driver_->connections;
    driver_->updates = true;  // the latest notification may still be on its way
  });
  return claimed;
}

bool MapStore::has_updates() {
  return driver_->has_updates();
}

void MapStore::check(const Warn& report) const {
  const auto feature = fingerprint_.find(kFeatureDimensions);
  const std::optional<int64_t> descriptor_dim = dimensions();
  const auto take = [&](MapEntry&& entry) {
    if (feature == fingerprint_.end()) return;  // not of a Map
    const int64_t feature_dim = std::atoll(feature->second.c_str());
    const std::string misfit = misfit_of(entry, feature_dim, descriptor_dim);
    if (!misfit.empty()) report(str(name(), ": entry ", entry.id, ": ", misfit));
  };
  read(0, take, report);
  driver_->transaction(Locking::kReads, [&] {
    read_values(*driver_, "");
    read_removed(*driver_, 0);
    driver_->execute("SELECT id FROM cloud ORDER BY id", {}, [&](const SqlRow& row) {
      try {
        read_cloud(*driver_, row.integer(0));
      } catch (const InputError& error) {
        report(error.what());
      }
    });
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
  const bool is_replaced = driver_->run(Locking::kWrites, [&] {
    const int64_t last = lock_counts(*driver_).entries;
    MapHeader header = read_header(*driver_);
    if (header.revision != revision) return false;
    int64_t after = 0;
    const auto replace = [&](MapEntry&& entry) {
      entry.descriptor = descriptor_of(entry);
      entry.feature.clear();
      const EntryBytes bytes = encoded(entry, header.format, static_cast<size_t>(entry.id));
      write_row(*driver_,
                "UPDATE entry SET drive = $2, frame = $3, time = $4, pose = $5, descriptor = $6, "
                "feature = $7, revision = $8, loops = $9, checksum = $10 WHERE id = $1",
                entry_columns(entry.id, entry, bytes, revision + 1));
    };
    for_each_entry(*driver_, header, after, last, replace, [](int64_t, const std::string&) {});
    ++header.revision;
    write_header(*driver_, header);
    for (const auto& [name, bytes] : values) write_value(*driver_, name, bytes);
    driver_->notify();
    return true;
  });
  if (is_replaced && driver_->dialect.give_back_space != nullptr) try {
      driver_->execute(driver_->dialect.give_back_space);
    } catch (const Error&) {  // later entries use the space
    }
  return is_replaced;
}

}  // namespace revisit
