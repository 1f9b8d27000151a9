#include "map_tables.h"

#include <span>
#include <string_view>

#include "revisit/base/error.h"

namespace revisit {
namespace {

constexpr int64_t kMaxRows = int64_t{1} << 48;  // limit for any map: larger ids may overflow
constexpr int64_t kEntriesAtOnce = 256;

/// A corrupt name may be NULL or a blob in a file.
constexpr const char* kNameOfValue = "coalesce(CAST(name AS TEXT), '')";

/// Of all tables but `entry`, which has columns that may be NULL.
int64_t checksum_of(std::span<const SqlValue> columns) {
  Checksum sum;
  for (const SqlValue& value : columns)
    if (const auto* number = std::get_if<int64_t>(&value))
      sum.number(*number);
    else if (const auto* text = std::get_if<std::string_view>(&value))
      sum.bytes(*text);
    else if (const auto* blob = std::get_if<Blob>(&value))
      sum.bytes(blob->bytes);
  return sum.value();
}

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

SqlValue null_if_empty(std::string_view bytes) {
  return bytes.empty() ? SqlValue(nullptr) : SqlValue(Blob{bytes});
}

Counts select_counts(SqlDriver& driver, const char* lock) {
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

/// Verifies the values that `where` selects. Returns the bytes of the last.
std::optional<std::string> select_values(SqlDriver& driver, const std::string& where,
                                         const std::vector<SqlValue>& parameters = {}) {
  std::optional<std::string> found;
  read_rows(driver, "SELECT id, name, bytes, checksum FROM value " + where, parameters, "a value",
            [&](const SqlRow& row) { found = row.bytes(2); });
  return found;
}

void check_number_of_values(SqlDriver& driver, const Counts& counts) {
  if (const auto n = driver.integer("SELECT count(*) FROM value"); n != counts.values)
    driver.fail_corrupt(
        str("it has ", n.value_or(0), " values beside its entries, expected ", counts.values));
}

std::string problem_of(const SqlRow& row, int64_t id, const MapHeader& header, MapEntry& entry) {
  try {
    return take_row(id,
                    {.drive = std::string(row.bytes(1)),
                     .frame = row.integer(2),
                     .time = row.real(3),
                     .pose = std::string(row.bytes(4)),
                     .descriptor = std::string(row.bytes(5)),
                     .feature = std::string(row.bytes(6)),
                     .revision = row.integer(7),
                     .checksum = row.integer(8)},
                    header, entry);
  } catch (const InputError&) {
    return "a column has a value of another type";
  }
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
          blob + ", descriptor" + blob + ", feature" + blob + ", revision" + integer + checksum,
      "CREATE TABLE removed" + id + ", entry" + integer + checksum,
      "CREATE TABLE cloud" + id + ", bytes" + blob + checksum,
  };
}

void create_tables(SqlDriver& driver, const MapHeader& header) {
  for (const std::string& table : table_definitions(driver.dialect)) driver.execute(table);
  write_header(driver, header);
  write_counts(driver, {});
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

void write_header(SqlDriver& driver, const MapHeader& header) {
  const std::string text = text_of(header.fingerprint), dtype = name_of(header.format);
  write_row(driver,
            "INSERT INTO map (id, fingerprint, dtype, revision, checksum) VALUES (1, $1, $2, $3, "
            "$4) ON CONFLICT (id) DO UPDATE SET fingerprint = excluded.fingerprint, dtype = "
            "excluded.dtype, revision = excluded.revision, checksum = excluded.checksum",
            {text, dtype, header.revision});
}

Counts read_counts(SqlDriver& driver) {
  return select_counts(driver, "");
}

Counts lock_counts(SqlDriver& driver) {
  return select_counts(driver, driver.dialect.for_update);
}

void write_counts(SqlDriver& driver, const Counts& counts) {
  write_row(driver,
            "INSERT INTO counts (id, entries, \"values\", checksum) VALUES (1, $1, $2, $3) ON "
            "CONFLICT (id) DO UPDATE SET entries = excluded.entries, \"values\" = "
            "excluded.\"values\", checksum = excluded.checksum",
            {counts.entries, counts.values});
}

void write_entry(SqlDriver& driver, const char* sql, int64_t id, EntryRow row, int64_t revision) {
  row.revision = revision;
  driver.execute(sql, {id, row.drive, row.frame, row.time ? SqlValue(*row.time) : nullptr,
                       null_if_empty(row.pose), Blob{row.descriptor}, null_if_empty(row.feature),
                       revision, checksum_of(id, row)});
}

int64_t for_each_entry(SqlDriver& driver, const MapHeader& header, int64_t& after, int64_t last,
                       const std::function<void(MapEntry&&)>& take,
                       const std::function<void(int64_t, const std::string&)>& report) {
  int64_t n = 0, rows = 0;
  do {
    rows = 0;
    driver.execute(
        "SELECT id, drive, frame, time, pose, descriptor, feature, revision, checksum FROM entry "
        "WHERE id > $1 AND id <= $2 ORDER BY id LIMIT $3",
        {after, last, kEntriesAtOnce}, [&](const SqlRow& row) {
          const int64_t id = row.integer(0);
          if (id <= after) driver.fail_corrupt(str("entry ", id, " is out of order"));
          after = id;
          ++rows;
          MapEntry entry;
          const std::string problem = problem_of(row, id, header, entry);
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

void write_cloud(SqlDriver& driver, int64_t id, const std::string& bytes) {
  write_row(driver, "INSERT INTO cloud (id, bytes, checksum) VALUES ($1, $2, $3)",
            {id, Blob{bytes}});
}

std::string read_cloud(SqlDriver& driver, int64_t id) {
  std::string bytes;
  read_rows(driver, "SELECT id, bytes, checksum FROM cloud WHERE id = $1", {id},
            str("the points of entry ", id), [&](const SqlRow& row) { bytes = row.bytes(1); });
  return bytes;
}

int64_t count_removed(SqlDriver& driver, int64_t after) {
  return driver.integer("SELECT count(*) FROM removed WHERE entry > $1", {after}).value_or(0);
}

std::vector<int64_t> read_removed(SqlDriver& driver, int64_t after) {
  std::vector<int64_t> entries;
  read_rows(driver, "SELECT id, entry, checksum FROM removed WHERE id > $1 ORDER BY id", {after},
            "a removed entry", [&](const SqlRow& row) { entries.push_back(row.integer(1)); });
  return entries;
}

void write_removed(SqlDriver& driver, int64_t entry) {
  // The database computes the id: it fails after the largest number.
  const auto id = driver.integer("SELECT coalesce(max(id), 0) + 1 FROM removed");
  write_row(driver, "INSERT INTO removed (id, entry, checksum) VALUES ($1, $2, $3)", {*id, entry});
}

std::optional<std::string> read_value(SqlDriver& driver, const std::string& name) {
  check_number_of_values(driver, read_counts(driver));
  auto bytes = select_values(driver, str("WHERE ", kNameOfValue, " = $1"), {name});
  // A corrupt byte may have changed the name. The usual values have theirs, and may be large.
  if (!bytes)
    select_values(driver,
                  str("WHERE ", kNameOfValue, " NOT IN ('", kProjectionValue, "', '",
                      kCalibrationValue, "', '", kVerifiedCalibrationValue, "', '", kThresholdValue,
                      "') AND ", kNameOfValue, " NOT LIKE '", kRecordingOf, "%'"));
  return bytes;
}

void write_value(SqlDriver& driver, const std::string& name, const std::string& bytes) {
  if (name.size() + bytes.size() > kMaxBytes - 1000)
    throw UsageError("value '", name, "' has ", bytes.size(),
                     " bytes, more than the limit of 256 MB");
  Counts counts = read_counts(driver);
  check_number_of_values(driver, counts);
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

void check_values(SqlDriver& driver) {
  check_number_of_values(driver, read_counts(driver));
  select_values(driver, "");
}

}  // namespace revisit
