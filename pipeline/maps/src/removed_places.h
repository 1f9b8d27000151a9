#pragma once

#include <span>
#include <vector>

#include "sqlite.h"

namespace revisit::pipeline {

int64_t removed_checksum(int64_t id, int64_t place);

/// How many of the places behind `after` were removed from a file.
int64_t count_removed(sqlite::Connection& connection, int64_t after);
/// The last id in the table `removed`, which counts removals.
int64_t last_removal(sqlite::Connection& connection);
/// The places that were removed, in the order of removal, but for the first `after`. Throws
/// InputError when the list is damaged.
std::vector<int64_t> read_removed(sqlite::Connection& connection, int64_t after);
/// Within a step: notes places that were removed, and that the file has such.
void write_removed(sqlite::Connection& connection, std::span<const int64_t> places);

}  // namespace revisit::pipeline
