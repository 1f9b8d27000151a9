#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

namespace revisit::pipeline {

/// Damage in a write-ahead log. SQLite reads it up to the first frame whose checksum is wrong and
/// says nothing of what follows.
struct JournalDamage {
  int64_t at = 0;              // [byte]
  bool lost_for_sure = false;  // or it may be a last step that a loss of power has cut
};

/// Looks for damage in `journal`, FILE-wal. Others may write to it meanwhile. (File format:
/// https://www.sqlite.org/fileformat2.html#walformat)
std::optional<JournalDamage> journal_damage(const std::filesystem::path& journal);

/// Whether SQLite's rollback journal names a second file, which SQLite removes when it rolls back.
/// Journals of maps name none: a stranger's names what the user is to lose.
bool names_a_file_to_remove(const std::filesystem::path& rollback_journal);

}  // namespace revisit::pipeline
