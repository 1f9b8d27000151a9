#pragma once

#include <filesystem>
#include <string>

namespace revisit {

/// Throws InputError if a corrupt frame in SQLite's write-ahead log hides later transactions:
/// SQLite treats the first frame with a wrong checksum as the end of the log
/// (sqlite.org/fileformat2.html#walformat). A single transaction behind it is not an error, because
/// a power failure can leave one. `log`: FILE-wal, which may be missing.
void check_log(const std::filesystem::path& log, const std::string& name);

}  // namespace revisit
