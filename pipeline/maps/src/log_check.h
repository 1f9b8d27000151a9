#pragma once

#include <filesystem>
#include <string>

namespace revisit::pipeline {

/// Throws InputError when damage in SQLite's log hides later steps: SQLite takes the first frame
/// whose checksum is wrong for the end of the log (sqlite.org/fileformat2.html#walformat). One step
/// behind it is no damage: a loss of power leaves it. `log`: FILE-wal, which may be missing.
void check_log(const std::filesystem::path& log, const std::string& name);

}  // namespace revisit::pipeline
