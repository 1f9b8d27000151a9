#pragma once

#include <span>
#include <string>
#include <vector>

#include "sqlite.h"

namespace revisit::pipeline {

/// What the table `removed` says of places, in the order of their removal.
struct RemovedPlaces {
  std::vector<int64_t> ids;
  std::string damage;  // why rows are missing: their places then count as lost
};

int64_t removed_checksum(int64_t id, int64_t place);

/// What of the list no removal from a map of the places 1 to `there` wrote; "" when nothing. Who
/// reads the places meets those that it lacks, as lost ones.
std::string damage_of(const RemovedPlaces& removed, int64_t there);

/// How many of the places 1 to `there` were removed from a file; 0 when that is damaged.
int64_t count_removed(sqlite::Connection& connection, int64_t there);
/// The last id in the table `removed`; 0 when it is damaged. Ids are missing where a row was lost.
int64_t last_removal(sqlite::Connection& connection);
/// All but the first `after`.
RemovedPlaces read_removed(sqlite::Connection& connection, int64_t after);
/// Within a step: notes places that were removed, and that the file has such.
void write_removed(sqlite::Connection& connection, std::span<const int64_t> places);

}  // namespace revisit::pipeline
