#pragma once

#include <span>
#include <vector>

#include "sqlite.h"

namespace revisit {

int64_t removed_checksum(int64_t id, int64_t place);

int64_t count_removed(sqlite::Connection& connection, int64_t after);
int64_t last_removal(sqlite::Connection& connection);
/// Ids in the order of removal, without the first `after`. Throws InputError if corrupt.
std::vector<int64_t> read_removed(sqlite::Connection& connection, int64_t after);
/// Raises the version of the file for the first ones. Must run in a transaction.
void write_removed(sqlite::Connection& connection, std::span<const int64_t> places);

}  // namespace revisit
