#pragma once

#include <cstdint>
#include <string>

#include "revisit/maps/map_store.h"
#include "sqlite.h"

namespace revisit {

constexpr int kApplicationId = 0x52565354;  // "RVST"
constexpr int kMapVersion = 3;
/// Version of a map without removed entries and clouds. The first removal raises it: older programs
/// would otherwise report these entries as lost.
constexpr int kFirstMapVersion = 1, kRemovedMapVersion = 2;
/// Sector size of disks and file systems, so that a transaction writes few bytes.
constexpr int kPageSize = 4096;

struct MapHead {
  MapFingerprint identity;
  DescriptorType format = DescriptorType::kFloat32;
  int64_t revision = 0;
};

/// Number of rows ever inserted: ids are 1 to these, so that missing rows are detected.
struct Counts {
  int64_t places = 0, values = 0;
};

int64_t head_checksum(std::string_view identity, int64_t bytes_per_number, int64_t revision);
int64_t checksum_of(const Counts& counts);

/// Needs an empty database. Throws UsageError as text_of().
void make_map(sqlite::Connection& connection, const MapHead& head);

void check_schema(sqlite::Connection& connection);

/// The first removal creates the table `removed`, in a transaction.
bool may_have_removed(sqlite::Connection& connection);
void make_table_of_removed(sqlite::Connection& connection);

/// The first cloud creates the table `cloud`; the version becomes kMapVersion.
bool may_have_clouds(sqlite::Connection& connection);
void make_table_of_clouds(sqlite::Connection& connection);
int64_t cloud_checksum(int64_t id, std::string_view bytes);

/// Throw InputError if the row is corrupt.
MapHead read_head(sqlite::Connection& connection);
Counts read_counts(sqlite::Connection& connection);
void write_head(sqlite::Connection& connection, const MapHead& head);
void write_counts(sqlite::Connection& connection, const Counts& counts);

}  // namespace revisit
