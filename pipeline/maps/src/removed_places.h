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

/// How many places were removed from a file; 0 when that is damaged.
int64_t count_removed(sqlite::Connection& connection);
/// All but the first `after`.
RemovedPlaces read_removed(sqlite::Connection& connection, int64_t after);
/// Within a step: notes places that were removed, and that the file has such.
void write_removed(sqlite::Connection& connection, std::span<const int64_t> places);

}  // namespace revisit::pipeline
