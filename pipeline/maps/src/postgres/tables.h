#pragma once

#include <cstdint>
#include <pqxx/pqxx>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "map_format.h"
#include "revisit/base/error.h"

/// The functions run in a transaction of the caller and throw what libpqxx throws.
namespace revisit::postgres {

/// Table `entry`: `call` is a random number of the call that added the entry. Table `expected`:
/// frames of WorkQueue::enqueue(); `entry` is the id of the frame's entry, 0 if the frame was
/// skipped, NULL while it is pending.
inline constexpr const char* kTables =
    "CREATE TABLE map (id INTEGER PRIMARY KEY, version INTEGER NOT NULL, fingerprint TEXT NOT "
    "NULL, dtype TEXT NOT NULL, revision BIGINT NOT NULL, checksum BIGINT NOT NULL);"
    "CREATE TABLE counts (id INTEGER PRIMARY KEY, entries BIGINT NOT NULL, checksum BIGINT NOT "
    "NULL);"
    "CREATE TABLE value (name TEXT PRIMARY KEY, bytes BYTEA NOT NULL, checksum BIGINT NOT NULL);"
    "CREATE TABLE entry (id BIGINT PRIMARY KEY, drive TEXT NOT NULL, frame BIGINT NOT NULL, time "
    "FLOAT8, pose BYTEA, descriptor BYTEA NOT NULL, feature BYTEA, revision BIGINT NOT NULL, "
    "checksum BIGINT NOT NULL, call BIGINT NOT NULL);"
    "CREATE TABLE removed (id BIGINT PRIMARY KEY, entry BIGINT NOT NULL UNIQUE, checksum BIGINT "
    "NOT NULL);"
    "CREATE TABLE cloud (id BIGINT PRIMARY KEY, bytes BYTEA NOT NULL, checksum BIGINT NOT NULL);"
    "CREATE TABLE expected (drive TEXT NOT NULL, frame BIGINT NOT NULL, entry BIGINT, error TEXT, "
    "PRIMARY KEY (drive, frame))";

inline constexpr int kEntriesAtOnce = 256;

pqxx::binarystring bytes_of(std::string_view text);
std::string bytes_in(const pqxx::field& field);
int64_t value_checksum(std::string_view name, std::string_view bytes);

/// Throws InputError with the prefix `name`.
MapHeader read_header(pqxx::transaction_base& step, const std::string& name);
void write_header(pqxx::transaction_base& step, const MapHeader& header);

bool has_table(pqxx::transaction_base& step, const std::string& map, const std::string& table);

void write_count(pqxx::transaction_base& step, int64_t entries);
/// Number of entries ever added; `lock` is appended to the statement. Throws InputError.
int64_t read_count(pqxx::transaction_base& step, const std::string& name, const char* lock = "");
/// Locks the row of read_count() until the commit; required before adding or changing entries. Ids
/// are then assigned in the order of commits: with a sequence, a reader that has seen id 7 could
/// miss a 6 that is committed later. Also waits until a commit of a lost connection has ended.
int64_t lock_entries(pqxx::transaction_base& step, const std::string& name);

int64_t count_removed(pqxx::transaction_base& step, int64_t after);
int64_t last_removal(pqxx::transaction_base& step);
/// Ids in the order of removal, without the first `after`. Throws InputError.
std::vector<int64_t> read_removed(pqxx::transaction_base& step, const std::string& name,
                                  int64_t after);
/// Removes existing or missing entries and records the removal.
void remove_entries(pqxx::transaction_base& step, const std::set<int64_t>& entries);

struct NewEntries {
  std::span<const MapEntry> entries;
  std::vector<EntryRow> rows;
  int64_t call;
  /// Throws UsageError for values that cannot be stored.
  NewEntries(std::span<const MapEntry> of, DescriptorType format);
};
/// `there`: result of lock_entries(). Returns the first id.
int64_t insert_entries(pqxx::transaction_base& step, const NewEntries& all, int64_t there,
                       const MapHeader& header);

void write_entry(pqxx::transaction_base& step, const char* sql, int64_t id, const MapEntry& entry,
                 const EntryRow& row, int64_t revision, int64_t call);
inline constexpr const char* kInsertEntryAt =
    "INSERT INTO entry VALUES ($1, $2, $3, nullif($4, '')::float8, nullif($5::bytea, ''), "
    "$6::bytea, nullif($7::bytea, ''), $8, $9, $10)";
inline constexpr const char* kReplaceEntryAt =
    "UPDATE entry SET drive = $2, frame = $3, time = nullif($4, '')::float8, pose = "
    "nullif($5::bytea, ''), descriptor = $6::bytea, feature = nullif($7::bytea, ''), revision = "
    "$8, checksum = $9, call = $10 WHERE id = $1";

/// Passes entries with ids in (`last`, `entries`] to `take` and advances `last`; passes id and
/// problem of each corrupt one to `warn`. Returns the number of rows.
template <class Take, class Defect>
int64_t select_entries(pqxx::transaction_base& step, const MapHeader& header, int64_t entries,
                       int64_t& last, const Take& take, const Defect& warn) {
  int64_t n = 0;
  while (last < entries) {
    const pqxx::result rows = step.exec_params(
        "SELECT id, drive, frame, time, pose, descriptor, feature, revision, checksum, call FROM "
        "entry WHERE id > $1 AND id <= $2 ORDER BY id LIMIT $3",
        last, entries, kEntriesAtOnce);
    for (const pqxx::row& found : rows) {
      last = found[0].as<int64_t>();
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
      MapEntry entry;
      const std::string defect = take_row(last, row, header, entry);
      if (defect.empty())
        take(std::move(entry), found[9].as<int64_t>());
      else
        warn(last, defect);
    }
    n += static_cast<int64_t>(rows.size());
    if (rows.size() < kEntriesAtOnce) last = entries;
  }
  return n;
}

}  // namespace revisit::postgres
