#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "revisit/base/hash.h"
#include "revisit/maps/map_store.h"
#include "sql_driver.h"

/// Values of a map's tables, equal in SQLite and PostgreSQL.
namespace revisit {

constexpr int kApplicationId = 0x52565354;  // "RVST"
constexpr int kMapVersion = 3;
/// Maximum length of a text or blob, and almost that of a row [bytes].
constexpr int kMaxBytes = 256 << 20;

/// Each update is bijective, so that any change within a single word is detected.
class Checksum {
 public:
  Checksum& number(int64_t value) {
    const uint64_t bits = std::bit_cast<uint64_t>(value);
    hash_ = fnv1a(hash_, static_cast<uint32_t>(bits));
    hash_ = fnv1a(hash_, static_cast<uint32_t>(bits >> 32));
    return *this;
  }

  Checksum& bytes(std::string_view bytes) {
    number(static_cast<int64_t>(bytes.size()));
    for (; !bytes.empty(); bytes.remove_prefix(bytes.size() < 4 ? bytes.size() : 4)) {
      uint32_t word = 0;
      std::memcpy(&word, bytes.data(), bytes.size() < 4 ? bytes.size() : 4);
      hash_ = fnv1a(hash_, word);
    }
    return *this;
  }

  /// Signed, as databases store integers.
  int64_t value() const { return std::bit_cast<int64_t>(hash_); }

 private:
  uint64_t hash_ = kFnv1aStart;
};

struct MapHeader {
  MapFingerprint fingerprint;
  DescriptorType format = DescriptorType::kFloat32;
  int64_t revision = 0;
};

/// Size of a value [bytes].
inline int64_t bytes_of(DescriptorType type) {
  return type == DescriptorType::kFloat16 ? 2 : 4;
}

/// Names in a MapFingerprint.
constexpr const char *kFeatureKey = "feature key", *kFeatureDimensions = "feature dimensions",
                     *kLocalMap = "local map";

/// Lines name=value. Throws UsageError for a "=" in a name or a line break.
std::string text_of(const MapFingerprint& fingerprint);
/// Throws InputError that lists each difference.
void must_match(const std::string& name, const MapFingerprint& map, const MapFingerprint& program);

/// Reads text_of().
MapFingerprint fingerprint_from(std::string_view text);

/// Number of rows ever inserted: ids are 1 to these, so that missing rows are detected.
struct Counts {
  int64_t entries = 0, values = 0;
};

/// FNV-1a over the columns of a row.
int64_t checksum_of(std::span<const SqlValue> columns);

/// Encoded values of an entry. Bytes are little-endian, the machine's own byte order.
struct EntryBytes {
  std::string pose;        // "", or 12 float64 [3][4]
  std::string descriptor;  // float32 or float16
  std::string feature;     // bfloat16, deflated
  std::string loops;       // "", or n, n loops, and ids of questioned ones
};
/// `number`: index in the call, from 1. Throws UsageError for values that cannot be stored.
EntryBytes encoded(const MapEntry& entry, DescriptorType format, size_t number);
/// Columns id, drive, frame, time, pose, descriptor, feature, revision, loops. Refers to the
/// arguments.
std::vector<SqlValue> entry_columns(int64_t id, const MapEntry& entry, const EntryBytes& bytes,
                                    int64_t revision);
/// Reads these columns and their checksum. Returns "", or the problem of the row.
std::string read_entry(const SqlRow& row, const MapHeader& header, MapEntry& entry);

/// Maximum dimensions of a feature, so that a small row of an untrusted map takes at most 64 MB.
inline constexpr uint32_t kMaxFeature = 1 << 24;
/// Rounds to the values that are read back, bfloat16.
void round_feature(std::span<float> feature);

/// Throws UsageError for a name with a zero byte, at which a server would truncate it.
void check_drive(const std::string& drive, const std::string& of = "");

/// `entries`: number of entries ever added. Throws UsageError for other ids.
std::set<int64_t> ids_to_remove(std::span<const int64_t> ids, int64_t entries);

/// Limit of magnitudes, so that sums of products of a few values do not overflow floats.
inline constexpr float kLargest = 1e9F;
inline constexpr const char* kTooLarge = "numbers that are not finite, or above 1e9";
bool is_usable(std::span<const float> numbers);
/// Returns "", or why a map with these dimensions cannot use the entry. `descriptor_dim`: absent
/// during the warm-up.
std::string misfit_of(const MapEntry& entry, int64_t feature_dim,
                      std::optional<int64_t> descriptor_dim);

/// Statements beside those of MapStore, in a transaction. Definitions: one per table, in this
/// order.
std::vector<std::string> table_definitions(const SqlDialect& dialect);
/// Throws UsageError as text_of().
void create_tables(SqlDriver& driver, const MapHeader& header);
void write_header(SqlDriver& driver, const MapHeader& header);
void write_counts(SqlDriver& driver, const Counts& counts);
/// Rows of entry_columns(). Many share a statement, because each takes a round trip to a server.
void insert_entries(SqlDriver& driver, std::span<const std::vector<SqlValue>> rows);
void write_removed(SqlDriver& driver, int64_t entry);

}  // namespace revisit
