#include <unistd.h>

#include <algorithm>
#include <array>
#include <string_view>

#include "acceptance.h"
#include "identity.h"
#include "log_check.h"
#include "postgres_map.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/recognition/ring/model.h"
#include "server_address.h"
#include "sqlite_map.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;
using sqlite::Connection;

struct File {
  fs::path path;  // absolute, without symbolic links, because SQLite's other files are beside it
  std::string name;
  bool is_there = false;
  uintmax_t bytes = 0;

  uintmax_t bytes_of_log() const {
    std::error_code none;
    const uintmax_t found = fs::file_size(path.string() + "-wal", none);
    return none ? 0 : found;
  }
};

/// SQLite opens these files whatever they are: opening a pipe would block forever. It would also
/// apply a journal, which changes the file and may remove another; maps have none.
void check_beside(const File& file) {
  for (const std::string ending : {"-wal", "-shm", "-journal"}) {
    std::error_code none;
    const fs::file_type type = fs::symlink_status(file.path.string() + ending, none).type();
    if (type == fs::file_type::not_found || type == fs::file_type::none) continue;
    if (type != fs::file_type::regular || ending == "-journal")
      throw InputError(file.name, ending,
                       ": unexpected file, which SQLite would use; move it away");
  }
}

File look_at(const fs::path& file) {
  std::error_code error;
  File found{.path = fs::weakly_canonical(fs::absolute(file), error), .name = file.string()};
  if (error) throw Error(found.name, ": cannot be opened: ", error.message());
  const fs::file_status status = fs::status(found.path, error);
  found.is_there = fs::exists(status);
  if (!found.is_there && status.type() != fs::file_type::not_found)
    throw Error(found.name, ": cannot be opened: ", error.message());
  if (found.is_there && !fs::is_regular_file(status))
    throw InputError(found.name, ": not a map: not a regular file");
  if (found.is_there) found.bytes = fs::file_size(found.path, error);
  check_beside(found);
  return found;
}

File look_at_existing(const fs::path& file) {
  File found = look_at(file);
  if (!found.is_there) throw InputError(found.name, ": there is no such map");
  if (found.bytes == 0) throw InputError(found.name, ": not a map: the file is empty");
  return found;
}

/// For a reader that cannot write beside the file, which no process may change meanwhile.
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

/// Reads only the header, without SQLite's locks, log and journal: a checkpoint interrupted by a
/// full disk or a kill may have copied half of the log to the file. A file stream is not usable,
/// because closing it releases all locks of this process on the file (sqlite.org/howtocorrupt.html,
/// 2.2).
void check_is_a_map(const File& file) {
  const Connection found(immutable_uri(file.path), SQLITE_OPEN_READONLY | SQLITE_OPEN_URI,
                         file.name);
  sqlite3_file* opened = nullptr;
  sqlite3_file_control(found.handle(), "main", SQLITE_FCNTL_FILE_POINTER, &opened);
  std::array<unsigned char, 100> header{};  // sqlite.org/fileformat2.html#the_database_header
  const int code = opened->pMethods->xRead(opened, header.data(), header.size(), 0);
  if (code != SQLITE_OK && code != SQLITE_IOERR_SHORT_READ) found.fail(code);
  constexpr std::string_view kMagic("SQLite format 3\0", 16);
  if (!std::equal(kMagic.begin(), kMagic.end(), header.begin())) found.fail(SQLITE_NOTADB);
  int64_t application = 0;
  for (size_t i = 68; i < 72; ++i) application = application << 8 | header[i];
  if (application != kApplicationId)
    throw InputError(file.name, ": a SQLite database, but not a map (application id ", application,
                     ", a map has ", kApplicationId, ")");
}

/// Creates the file atomically, so that SQLite never creates a journal.
void make_map_file(const File& file, const MapFingerprint& identity, DescriptorType format) {
  if (file.bytes_of_log() > 0)
    throw InputError(file.name, "-wal: a log without its map; move it away");
  Connection map(":memory:", SQLITE_OPEN_READWRITE, file.name);
  make_map(map, {.identity = identity, .format = format});
  std::string bytes = map.content();
  bytes[18] = bytes[19] = 2;  // WAL mode: https://www.sqlite.org/fileformat2.html#vnums
  write_atomically(file.path, [&](std::ostream& out) { out << bytes; });
}

std::unique_ptr<Connection> open_for_reading(const File& file) {
  const bool may_write_beside = ::access(file.path.parent_path().c_str(), W_OK) == 0;
  auto connection = std::make_unique<Connection>(file.path, SQLITE_OPEN_READONLY, file.name);
  const int code =
      sqlite3_exec(connection->handle(), "SELECT 1 FROM sqlite_schema", nullptr, nullptr, nullptr);
  const int kind = code & 0xFF;
  if (code == SQLITE_OK) return connection;
  // Readers of a log share memory in FILE-shm, which this process cannot create.
  if (may_write_beside || (kind != SQLITE_CANTOPEN && kind != SQLITE_READONLY))
    connection->fail(code);
  if (file.bytes_of_log() > 0)
    throw Error(file.name,
                "-wal: its places cannot be read, because the folder cannot be written; ",
                "copy both files to another folder");
  return std::make_unique<Connection>(immutable_uri(file.path),
                                      SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, file.name);
}

std::unique_ptr<Connection> open_for_writing(const File& file) {
  auto connection = std::make_unique<Connection>(file.path, SQLITE_OPEN_READWRITE, file.name);
  if (sqlite3_db_readonly(connection->handle(), nullptr) != 0) connection->fail(SQLITE_READONLY);
  check_schema(*connection);
  if (const std::string mode = connection->text("PRAGMA journal_mode = WAL"); mode != "wal")
    throw Error(file.name, ": this file system has no shared memory for SQLite's log (", mode,
                " instead of WAL); use a local disk");
  connection->execute("PRAGMA synchronous = FULL");  // commits are durable
  return connection;
}

std::unique_ptr<SqliteMap> open_existing(const File& file) {
  check_is_a_map(file);
  check_log(file.path.string() + "-wal", file.name);
  auto connection = open_for_reading(file);
  check_schema(*connection);
  return std::make_unique<SqliteMap>(nullptr, std::move(connection));
}

std::unique_ptr<SqliteMap> open_writer(const fs::path& file, MapAccess access,
                                       const MapFingerprint* identity, DescriptorType format) {
  const auto look = [&] {
    File found = identity == nullptr ? look_at_existing(file) : look_at(file);
    if (access == MapAccess::kNew && found.is_there)
      throw InputError(found.name, ": already exists");
    if (found.bytes > 0) check_is_a_map(found);
    return found;
  };
  File found = look();
  auto lock = std::make_unique<WriterLock>(found.path, found.name);
  found = look();  // another process may have created it meanwhile
  if (found.bytes == 0) make_map_file(found, *identity, format);
  check_log(found.path.string() + "-wal", found.name);
  return std::make_unique<SqliteMap>(std::move(lock), open_for_writing(found));
}

}  // namespace

bool is_server_address(std::string_view where) {
  return where.starts_with("postgresql://") || where.starts_with("postgres://");
}

std::string display_name(const fs::path& map) {
  return is_server_address(map.string()) ? postgres::parse_address(map.string()).name
                                         : map.string();
}

std::unique_ptr<MapStore> open_map(const fs::path& file, MapAccess access,
                                   const MapFingerprint* identity, DescriptorType format) {
  std::unique_ptr<MapStore> map;
  if (is_server_address(file.string()))
    map = open_postgres_map(file.string(), access, identity, format);
  else if (access == MapAccess::kRead)
    map = open_existing(look_at_existing(file));
  else
    map = open_writer(file, access, identity, format);
  if (identity != nullptr) must_match(display_name(file), map->fingerprint(), *identity);
  return map;
}

std::string feature_key_of(const fs::path& map) {
  if (map.empty()) return "";
  try {
    const MapFingerprint identity = open_map(map, MapAccess::kRead)->fingerprint();
    const auto made_by = identity.find("made by");
    return made_by == identity.end() ? "" : made_by->second;
  } catch (const InputError&) {
    return "";
  }
}

namespace {

void check_basis(const MapStore& map) {
  const auto basis = map.value(kProjectionValue);
  MapFingerprint identity = map.fingerprint();
  if (!basis || identity["feature"] != "ring") return;
  const int64_t dim = parse_ring_model(*basis, "the map's basis").dim();
  if (str(dim) != identity["numbers"])
    throw InputError("the map's basis: for ring descriptors of ", dim,
                     " numbers, but its places have ", identity["numbers"]);
}

}  // namespace

std::vector<std::string> check_map(const fs::path& file) {
  if (!is_server_address(file.string())) look_at_existing(file);
  std::vector<std::string> wrong;
  const auto tell = [&](const std::string& what) { wrong.push_back(what); };
  try {
    const auto map = open_map(file, MapAccess::kRead);
    map->check(tell);
    check_kept(*map, tell);
    check_basis(*map);
  } catch (const InputError& error) {
    wrong.emplace_back(error.what());
  }
  return wrong;
}

std::unique_ptr<WorkQueue> open_work_queue(const fs::path& map) {
  return is_server_address(map.string()) ? open_postgres_work(map.string()) : nullptr;
}

}  // namespace revisit
