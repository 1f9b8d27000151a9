#include "tables.h"

#include <random>

#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit::postgres {

using pqxx::binarystring;

namespace {

constexpr int64_t kMaxEntries = int64_t{1} << 48;  // limit for any map: larger ids may overflow

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

MapHeader read_header(pqxx::transaction_base& step, const std::string& name) {
  const pqxx::result rows =
      step.exec("SELECT version, fingerprint, dtype, revision, checksum FROM map WHERE id = 1");
  if (rows.empty()) throw InputError(name, ": this map is corrupt: its header is missing");
  const pqxx::row row = rows[0];
  if (row[0].as<int>() != kMapVersion)
    throw InputError(name, ": map version ", row[0].as<int>(), " (expected ", kMapVersion,
                     "); build the map again, or use another revisit");
  auto header = header_from(row[1].as<std::string>(), row[2].as<std::string>(),
                            row[3].as<int64_t>(), row[4].as<int64_t>());
  if (!header) throw InputError(name, ": this map is corrupt: the checksum of its header is wrong");
  return *std::move(header);
}

void write_header(pqxx::transaction_base& step, const MapHeader& header) {
  const std::string fingerprint = text_of(header.fingerprint), dtype = name_of(header.format);
  step.exec_params(
      "INSERT INTO map VALUES (1, $1, $2, $3, $4, $5) ON CONFLICT (id) DO UPDATE SET revision = "
      "EXCLUDED.revision, checksum = EXCLUDED.checksum",
      kMapVersion, fingerprint, dtype, header.revision,
      header_checksum(fingerprint, dtype, header.revision));
}

void write_count(pqxx::transaction_base& step, int64_t entries) {
  step.exec_params(
      "INSERT INTO counts VALUES (1, $1, $2) ON CONFLICT (id) DO UPDATE SET entries = "
      "EXCLUDED.entries, checksum = EXCLUDED.checksum",
      entries, checksum_of(Counts{.entries = entries}));
}

bool has_table(pqxx::transaction_base& step, const std::string& map, const std::string& table) {
  // Not to_regclass(), which caches within a transaction that a schema is missing.
  return !step.exec_params("SELECT 1 FROM pg_tables WHERE schemaname = $1 AND tablename = $2", map,
                           table)
              .empty();
}

int64_t read_count(pqxx::transaction_base& step, const std::string& name, const char* lock) {
  const pqxx::result rows =
      step.exec(str("SELECT entries, checksum FROM counts WHERE id = 1", lock));
  const auto entries = rows.empty() ? -1 : rows[0][0].as<int64_t>();
  if (entries < 0 || entries > kMaxEntries ||
      checksum_of(Counts{.entries = entries}) != rows[0][1].as<int64_t>())
    throw InputError(name, ": this map is corrupt: the number of its entries is ",
                     rows.empty() ? "missing" : "wrong", "; restore a copy");
  return entries;
}

int64_t count_removed(pqxx::transaction_base& step, int64_t after) {
  return step.exec_params("SELECT count(*) FROM removed WHERE entry > $1", after)[0][0]
      .as<int64_t>();
}

int64_t last_removal(pqxx::transaction_base& step) {
  return step.exec("SELECT coalesce(max(id), 0) FROM removed")[0][0].as<int64_t>();
}

std::vector<int64_t> read_removed(pqxx::transaction_base& step, const std::string& name,
                                  int64_t after) {
  std::vector<int64_t> entries;
  for (const pqxx::row& row : step.exec_params(
           "SELECT id, entry, checksum FROM removed WHERE id > $1 ORDER BY id", after)) {
    entries.push_back(row[1].as<int64_t>());
    if (removed_checksum(row[0].as<int64_t>(), entries.back()) != row[2].as<int64_t>())
      throw InputError(name, ": this map is corrupt: a checksum in the list of removed entries ",
                       "is wrong; restore a copy");
  }
  return entries;
}

void remove_entries(pqxx::transaction_base& step, const std::set<int64_t>& entries) {
  const auto n = static_cast<int64_t>(entries.size());
  // The server computes the id: it fails after the largest number.
  const auto last = step.exec(str("SELECT coalesce(max(id), 0) + ", n, " FROM removed"))[0][0];
  int64_t id = last.as<int64_t>() - n;
  for (const int64_t entry : entries) {
    ++id;
    step.exec_params("DELETE FROM entry WHERE id = $1", entry);
    step.exec_params("DELETE FROM cloud WHERE id = $1", entry);
    step.exec_params("DELETE FROM expected WHERE entry = $1",
                     entry);  // the frame can be enqueued again
    step.exec_params("INSERT INTO removed VALUES ($1, $2, $3)", id, entry,
                     removed_checksum(id, entry));
  }
}

NewEntries::NewEntries(std::span<const MapEntry> of, DescriptorType format) : entries(of) {
  std::random_device random;
  call = static_cast<int64_t>((uint64_t{random()} << 32) | random());
  for (const MapEntry& entry : entries) rows.push_back(entry_row(entry, format, rows.size() + 1));
}

int64_t insert_entries(pqxx::transaction_base& step, const NewEntries& all, int64_t there,
                       const MapHeader& header) {
  for (size_t i = 0; i < all.rows.size(); ++i)
    write_entry(step, kInsertEntryAt, there + 1 + static_cast<int64_t>(i), all.entries[i],
                all.rows[i], header.revision, all.call);
  for (size_t i = 0; i < all.entries.size(); ++i) {
    const std::string& cloud = all.entries[i].cloud;
    const int64_t id = there + 1 + static_cast<int64_t>(i);
    if (!cloud.empty())
      step.exec_params("INSERT INTO cloud VALUES ($1, $2, $3)", id, bytes_of(cloud),
                       cloud_checksum(id, cloud));
  }
  write_count(step, there + static_cast<int64_t>(all.rows.size()));
  return there + 1;
}

int64_t lock_entries(pqxx::transaction_base& step, const std::string& name) {
  return read_count(step, name, " FOR UPDATE");
}

void write_entry(pqxx::transaction_base& step, const char* sql, int64_t id, const MapEntry& entry,
                 const EntryRow& row, int64_t revision, int64_t call) {
  const RowView view = view_of(entry, row, revision);
  const std::string time = view.time ? exact(*view.time) : "";  // in every locale
  step.exec_params(sql, id, entry.drive, view.frame, time, bytes_of(view.pose),
                   bytes_of(view.descriptor), bytes_of(view.feature), revision,
                   checksum_of(id, view), call);
}

}  // namespace revisit::postgres
