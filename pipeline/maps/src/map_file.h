#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "map_format.h"

namespace revisit {

class SqliteDriver;

/// Makes this process the only writer of a map, until the result or the process ends, by a lock on
/// FILE-writer, whose descriptor it returns. SQLite's own lock lasts for one transaction; a lock on
/// the map itself would release SQLite's locks when closed. Throws Error if there is another
/// writer, or no permission.
std::shared_ptr<const int> lock_writer(const std::filesystem::path& map, const std::string& name);

/// File of a map and the files beside it, which SQLite uses: FILE-wal and FILE-shm.
class MapFile {
 public:
  /// Throws InputError for anything but a regular file, and for files beside it that are not of a
  /// map: SQLite opens these whatever they are. Opening a pipe would block forever, and a journal
  /// would be applied, which changes the file and may remove another; maps have none.
  explicit MapFile(const std::filesystem::path& file);
  /// Throws InputError if the file is missing or empty.
  static MapFile existing(const std::filesystem::path& file);

  const std::string& name() const { return name_; }
  bool exists() const { return exists_; }
  bool is_empty() const { return bytes_ == 0; }

  /// Throws InputError for a database of another program. Reads only the header, without SQLite's
  /// locks, log and journal: a checkpoint interrupted by a full disk or a kill may have copied half
  /// of the log to the file. A file stream is not usable, because closing it releases all locks of
  /// this process on the file (sqlite.org/howtocorrupt.html, 2.2).
  void check_is_a_map() const;
  /// Creates the file atomically, so that SQLite never creates a journal.
  void make(const MapHeader& header) const;

  std::shared_ptr<const int> lock() const { return lock_writer(path_, name_); }
  /// In a folder that cannot be written, the file is read as it is, without locks; it may then have
  /// no log.
  std::unique_ptr<SqlDriver> open_for_reading() const;
  std::unique_ptr<SqlDriver> open_for_writing(std::shared_ptr<const int> lock) const;

 private:
  /// Rejects other versions, views, triggers and tables.
  void check_schema(SqliteDriver& driver) const;
  uintmax_t bytes_of_log() const;

  std::filesystem::path path_;  // absolute, without symbolic links, as SQLite's other files
  std::string name_;
  bool exists_ = false;
  uintmax_t bytes_ = 0;
};

/// A map for this object only, in a nameless file on the disk, because clouds need space.
std::unique_ptr<MapStore> temporary_map(const MapFingerprint& fingerprint);

}  // namespace revisit
