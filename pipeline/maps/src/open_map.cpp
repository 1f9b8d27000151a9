#include <unistd.h>

#include "identity.h"
#include "journal.h"
#include "postgres_map.h"
#include "revisit/base/error.h"
#include "server_address.h"
#include "sqlite_map.h"

namespace revisit::pipeline {
namespace {

namespace fs = std::filesystem;
using sqlite::Connection;

struct File {
  fs::path path;     // absolute, without symbolic links: SQLite's other files are beside it
  std::string name;  // as the user knows it
  bool is_there = false;

  fs::path journal() const { return path.string() + "-wal"; }
};

/// SQLite opens what is beside the file whatever it is: a pipe would be waited for without end.
void must_be_plain(const File& file) {
  for (const char* ending : {"-wal", "-shm", "-journal"}) {
    std::error_code none;
    const fs::file_type type = fs::symlink_status(file.path.string() + ending, none).type();
    if (type != fs::file_type::regular && type != fs::file_type::not_found &&
        type != fs::file_type::none)
      throw InputError(str(file.name, ending,
                           ": not a file, which it has to be beside a map; "
                           "move it away"));
  }
  if (names_a_file_to_remove(file.path.string() + "-journal"))
    throw InputError(str(file.name,
                         "-journal: not of a map, and would remove another file; move "
                         "it away"));
}

File look_at(const fs::path& file) {
  std::error_code error;
  File found{.path = fs::weakly_canonical(fs::absolute(file), error), .name = file.string()};
  if (error) throw Error(str(found.name, ": cannot be opened: ", error.message()));
  const fs::file_status status = fs::status(found.path, error);
  found.is_there = fs::exists(status);
  if (!found.is_there && status.type() != fs::file_type::not_found)
    throw Error(str(found.name, ": cannot be opened: ", error.message()));
  if (found.is_there && !fs::is_regular_file(status))
    throw InputError(str(found.name, ": not a map: not a file"));
  must_be_plain(found);
  return found;
}

File look_at_existing(const fs::path& file) {
  File found = look_at(file);
  if (!found.is_there) throw InputError(str(found.name, ": there is no such map"));
  std::error_code error;
  if (fs::file_size(found.path, error) == 0 && !error)
    throw InputError(str(found.name, ": not a map: the file is empty"));
  return found;
}

std::string loss_of(const File& file, const JournalDamage& damage) {
  return str(file.name, "-wal: damaged at byte ", damage.at, ": the steps after it are lost",
             damage.lost_for_sure ? "" : "; if the power failed there, none of them had finished");
}

/// The same path, for a reader that cannot write beside the file: nobody changes it meanwhile.
std::string immutable_uri(const fs::path& path) {
  std::string uri = "file://";
  for (const char c : path.string()) {
    if (c == '%' || c == '?' || c == '#')
      uri += c == '%' ? "%25" : c == '?' ? "%3f" : "%23";
    else
      uri += c;
  }
  return uri + "?immutable=1";
}

std::unique_ptr<Connection> open_for_reading(const File& file, std::vector<std::string>& losses) {
  if (const auto damage = journal_damage(file.journal())) losses.push_back(loss_of(file, *damage));
  const bool may_write_beside = ::access(file.path.parent_path().c_str(), W_OK) == 0;
  auto connection = std::make_unique<Connection>(file.path, SQLITE_OPEN_READONLY, file.name);
  const int code =
      sqlite3_exec(connection->handle(), "SELECT 1 FROM sqlite_schema", nullptr, nullptr, nullptr);
  const int kind = code & 0xFF;
  // Readers of a log share memory in FILE-shm, which this process cannot make.
  if (!may_write_beside && (kind == SQLITE_CANTOPEN || kind == SQLITE_READONLY)) {
    connection = std::make_unique<Connection>(immutable_uri(file.path),
                                              SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, file.name);
    std::error_code none;
    if (const auto bytes = fs::file_size(file.journal(), none); !none && bytes > 0)
      losses.push_back(str(file.name, "-wal: its ", bytes,
                           " bytes cannot be read in a folder that cannot be written: the places "
                           "in it are not seen; copy both files to another folder"));
  } else if (code != SQLITE_OK) {
    connection->fail(code);
  }
  return connection;
}

std::unique_ptr<Connection> open_for_writing(const File& file, const MapIdentity* identity,
                                             NumberFormat format,
                                             std::vector<std::string>& losses) {
  if (const auto damage = journal_damage(file.journal())) {
    // To go on would write over what remains, and give ids a second time.
    if (damage->lost_for_sure)
      throw InputError(str(loss_of(file, *damage), "; it can be read; `sqlite3 ", file.name,
                           " 'PRAGMA wal_checkpoint(TRUNCATE)'` accepts the loss"));
    losses.push_back(loss_of(file, *damage));
  }
  auto connection = std::make_unique<Connection>(
      file.path, SQLITE_OPEN_READWRITE | (identity != nullptr ? SQLITE_OPEN_CREATE : 0), file.name);
  if (sqlite3_db_readonly(connection->handle(), nullptr) != 0) connection->fail(SQLITE_READONLY);
  if (connection->integer("PRAGMA page_count") == 0) {  // also after a kill when it was made
    if (identity == nullptr) throw InputError(str(file.name, ": not a map: the file is empty"));
    make_map(*connection, {.identity = *identity, .format = format});
  }
  check_schema(*connection);
  if (const std::string mode = connection->text("PRAGMA journal_mode = WAL"); mode != "wal")
    throw Error(str(file.name, ": this file system has no shared memory for SQLite's log (", mode,
                    " instead of WAL); use a local disk"));
  connection->execute("PRAGMA synchronous = FULL");  // a step is on the disk when it ends
  // The log only grows while it is in use: a kill leaves no frame that looks like damage.
  connection->execute("PRAGMA journal_size_limit = 0");
  return connection;
}

std::unique_ptr<SqliteMap> open_existing(const File& file) {
  std::vector<std::string> losses;
  auto connection = open_for_reading(file, losses);
  check_schema(*connection);
  return std::make_unique<SqliteMap>(nullptr, std::move(connection), std::move(losses));
}

}  // namespace

bool is_on_a_server(std::string_view where) {
  return where.starts_with("postgresql://") || where.starts_with("postgres://");
}

std::string shown_name(const fs::path& map) {
  return is_on_a_server(map.string()) ? postgres::parse_address(map.string()).name : map.string();
}

std::unique_ptr<MapStore> open_map(const fs::path& file, MapAccess access,
                                   const MapIdentity* identity, NumberFormat format) {
  if (is_on_a_server(file.string()))
    return open_postgres_map(file.string(), access, identity, format);
  std::unique_ptr<SqliteMap> map;
  if (access == MapAccess::kRead) {
    map = open_existing(look_at_existing(file));
  } else {
    const File found = identity == nullptr ? look_at_existing(file) : look_at(file);
    if (access == MapAccess::kNew && found.is_there)
      throw InputError(str(found.name, ": already exists"));
    auto lock = std::make_unique<WriterLock>(found.path, found.name);
    std::vector<std::string> losses;
    auto connection = open_for_writing(found, identity, format, losses);
    map = std::make_unique<SqliteMap>(std::move(lock), std::move(connection), std::move(losses));
  }
  if (identity != nullptr) must_match(shown_name(file), map->identity(), *identity);
  return map;
}

std::vector<std::string> check_map(const fs::path& file) {
  if (is_on_a_server(file.string())) return check_postgres_map(file.string());
  const File found = look_at_existing(file);
  try {
    return open_existing(found)->check();
  } catch (const InputError& error) {
    return {error.what()};
  }
}

}  // namespace revisit::pipeline
