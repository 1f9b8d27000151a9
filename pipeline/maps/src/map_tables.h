#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "map_format.h"
#include "sql_driver.h"

/// Statements on the tables of a map, beside those of MapStore. They must run in a transaction.
namespace revisit {

/// One per table, in this order.
std::vector<std::string> table_definitions(const SqlDialect& dialect);
/// Creates the tables. Throws UsageError as text_of().
void create_tables(SqlDriver& driver, const MapHeader& header);

void write_header(SqlDriver& driver, const MapHeader& header);
void write_counts(SqlDriver& driver, const Counts& counts);
/// With the ids `first`, `first` + 1, ... Many rows share a statement, because each takes a round
/// trip to a server.
void insert_entries(SqlDriver& driver, int64_t first, std::span<EntryRow> rows, int64_t revision);
void write_removed(SqlDriver& driver, int64_t entry);

}  // namespace revisit
