#pragma once

#include <cstdint>
#include <string>

#include "revisit/maps/map_store.h"
#include "sqlite.h"

namespace revisit::pipeline {

constexpr int kApplicationId = 0x52565354;  // "RVST"
constexpr int kMapVersion = 3;
/// Of a map from which no place was removed, and which has no clouds. The first removal makes it
/// the next: a program that knows no removal would call these places lost, and refuses that
/// instead.
constexpr int kFirstMapVersion = 1, kRemovedMapVersion = 2;
/// The smallest unit of disks and file systems, so that a step writes few bytes.
constexpr int kPageSize = 4096;

/// What is said once about a map.
struct MapHead {
  MapIdentity identity;
  NumberFormat format = NumberFormat::kFloat32;
  int64_t revision = 0;  // how often descriptors were replaced
};

/// How many rows there are or were: ids are 1 to these. So no row can be missing unnoticed, but for
/// places in the table `removed`.
struct Counts {
  int64_t places = 0, values = 0;
};

int64_t head_checksum(std::string_view identity, int64_t bytes_per_number, int64_t revision);
int64_t checksum_of(const Counts& counts);

/// Makes the tables in an empty database. Throws UsageError for an identity with "=" in a name or a
/// line break.
void make_map(sqlite::Connection& connection, const MapHead& head);

/// Holds the tables against those of make_map(). Throws InputError.
void check_schema(sqlite::Connection& connection);

/// Whether the file has the table `removed`. It gets it with the first removal, within a step.
bool may_have_removed(sqlite::Connection& connection);
void make_table_of_removed(sqlite::Connection& connection);

/// The same for the table `cloud`, which comes with the first cloud and kMapVersion.
bool may_have_clouds(sqlite::Connection& connection);
void make_table_of_clouds(sqlite::Connection& connection);
int64_t cloud_checksum(int64_t id, std::string_view bytes);

/// These two throw InputError for what is damaged.
MapHead read_head(sqlite::Connection& connection);
Counts read_counts(sqlite::Connection& connection);
void write_head(sqlite::Connection& connection, const MapHead& head);
void write_counts(sqlite::Connection& connection, const Counts& counts);

}  // namespace revisit::pipeline
