#include "map_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <new>
#include <string_view>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "sqlite_driver.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

/// Sector size of disks and file systems, so that a transaction writes few bytes.
constexpr int kPageSize = 4096;

/// For a reader that cannot write beside the file, which no process may change meanwhile.
std::string immutable_uri(const fs::path& path) {
  std::string uri = "file:";
  for (const unsigned char byte : path.string())
    for (const char c : {'%', "0123456789abcdef"[byte >> 4], "0123456789abcdef"[byte & 15]})
      uri += c;
  return uri + "?immutable=1";
}

}  // namespace

std::shared_ptr<const int> lock_writer(const fs::path& map, const std::string& name) {
  check_target(map);
  const fs::path file = map.string() + "-writer";
  while (true) {
    const int descriptor = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
    if (descriptor < 0)
      throw Error(name, ": cannot be written: ", file.filename().string(), ": ",
                  std::strerror(errno));
    const bool is_locked = ::flock(descriptor, LOCK_EX | LOCK_NB) == 0;
    const int reason = errno;
    if (is_locked && is_named(descriptor, file))  // a writer that ends removes it
      return {new int(descriptor), [file, owner = ::getpid()](const int* held) {
                if (::getpid() == owner) ::unlink(file.c_str());  // not in a forked child
                ::close(*held);
                delete held;
              }};
    ::close(descriptor);
    if (is_locked) continue;
    if (reason == EWOULDBLOCK)
      throw Error(name, ": another process is writing to this map; wait for it to end");
    throw Error(name, ": cannot be locked: ", std::strerror(reason));
  }
}

MapFile::MapFile(const fs::path& file) : name_(file.string()) {
  std::error_code error;
  path_ = fs::weakly_canonical(fs::absolute(file), error);
  if (error) throw Error(name_, ": cannot be opened: ", error.message());
  const fs::file_status status = fs::status(path_, error);
  exists_ = fs::exists(status);
  if (!exists_ && status.type() != fs::file_type::not_found)
    throw Error(name_, ": cannot be opened: ", error.message());
  if (exists_ && !fs::is_regular_file(status))
    throw InputError(name_, ": not a map: not a regular file");
  if (exists_) bytes_ = fs::file_size(path_, error);
  for (const std::string ending : {"-wal", "-shm", "-journal"}) {
    const fs::file_type type = fs::symlink_status(path_.string() + ending, error).type();
    if (type == fs::file_type::not_found || type == fs::file_type::none) continue;
    if (type != fs::file_type::regular || ending == "-journal")
      throw InputError(name_, ending, ": unexpected file, which SQLite would use; move it away");
  }
}

MapFile MapFile::existing(const fs::path& file) {
  MapFile found(file);
  if (!found.exists()) throw InputError(found.name(), ": there is no such map");
  if (found.is_empty()) throw InputError(found.name(), ": not a map: the file is empty");
  return found;
}

uintmax_t MapFile::bytes_of_log() const {
  std::error_code none;
  const uintmax_t found = fs::file_size(path_.string() + "-wal", none);
  return none ? 0 : found;
}

void MapFile::check_is_a_map() const {
  const SqliteDriver found(immutable_uri(path_), SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, name_);
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
    throw InputError(name_, ": a SQLite database, but not a map (application id ", application,
                     ", a map has ", kApplicationId, ")");
}

void MapFile::make(const MapHeader& header) const {
  if (bytes_of_log() > 0) throw InputError(name_, "-wal: a log without its map; move it away");
  SqliteDriver map(":memory:", SQLITE_OPEN_READWRITE, name_);
  map.execute(str("PRAGMA page_size = ", kPageSize));
  map.execute("PRAGMA auto_vacuum = NONE");
  map.execute(str("PRAGMA application_id = ", kApplicationId));
  map.execute(str("PRAGMA user_version = ", kMapVersion));
  create_tables(map, header);
  sqlite3_int64 size = 0;
  const std::unique_ptr<unsigned char, decltype(&sqlite3_free)> bytes(
      sqlite3_serialize(map.handle(), "main", &size, 0), &sqlite3_free);
  if (bytes == nullptr) throw std::bad_alloc();
  bytes.get()[18] = bytes.get()[19] = 2;  // WAL mode: sqlite.org/fileformat2.html#vnums
  write_atomically(path_, [&](std::ostream& out) {
    out.write(reinterpret_cast<const char*>(bytes.get()), size);
  });
}

void MapFile::check_schema(SqliteDriver& driver) const {
  const int64_t version = driver.integer("PRAGMA user_version").value_or(0);
  if (version != kMapVersion)
    throw InputError(name_, ": map version ", version, " (expected ", kMapVersion,
                     "); build the map again, or use another revisit");
  // A writer would use other pages as pages of entries.
  if (driver.integer("PRAGMA auto_vacuum") != 0) driver.fail_corrupt("it has auto_vacuum");
  const std::vector<std::string> expected = table_definitions(kSqlite);
  std::vector<std::string> found;
  driver.execute(str("SELECT sql FROM sqlite_schema ORDER BY rowid LIMIT ", expected.size() + 1),
                 {}, [&](const SqlRow& row) { found.emplace_back(row.bytes(0)); });
  if (found != expected) driver.fail_corrupt("its tables are not those of a map");
}

std::unique_ptr<SqlDriver> MapFile::open_for_reading() const {
  check_is_a_map();
  const bool may_write_beside = ::access(path_.parent_path().c_str(), W_OK) == 0;
  auto driver = std::make_unique<SqliteDriver>(path_, SQLITE_OPEN_READONLY, name_);
  const int code =
      sqlite3_exec(driver->handle(), "SELECT 1 FROM sqlite_schema", nullptr, nullptr, nullptr);
  if (code != SQLITE_OK) {
    // Readers of a log share memory in FILE-shm, which this process cannot create.
    const int kind = code & 0xFF;
    if (may_write_beside || (kind != SQLITE_CANTOPEN && kind != SQLITE_READONLY))
      driver->fail(code);
    if (bytes_of_log() > 0)
      throw Error(name_, "-wal: its entries cannot be read, because the folder cannot be written; ",
                  "copy both files to another folder");
    driver = std::make_unique<SqliteDriver>(immutable_uri(path_),
                                            SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, name_);
  }
  check_schema(*driver);
  return driver;
}

std::unique_ptr<SqlDriver> MapFile::open_for_writing(std::shared_ptr<const int> lock) const {
  auto driver =
      std::make_unique<SqliteDriver>(path_, SQLITE_OPEN_READWRITE, name_, std::move(lock));
  if (sqlite3_db_readonly(driver->handle(), nullptr) != 0) driver->fail(SQLITE_READONLY);
  check_schema(*driver);
  std::string mode;
  driver->execute("PRAGMA journal_mode = WAL", {}, [&](const SqlRow& row) { mode = row.bytes(0); });
  if (mode != "wal")
    throw Error(name_, ": this file system has no shared memory for SQLite's log (", mode,
                " instead of WAL); use a local disk");
  driver->execute("PRAGMA synchronous = FULL");  // commits are durable
  return driver;
}

std::unique_ptr<MapStore> temporary_map(const MapFingerprint& fingerprint) {
  auto driver = std::make_unique<SqliteDriver>(
      "", SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE,
      "the temporary map in TMPDIR, /var/tmp or /tmp, one of which must be writable");
  // SQLite makes the file when its cache is full: now, rather than after hours.
  driver->execute("PRAGMA cache_size = 1");
  create_tables(*driver, {.fingerprint = fingerprint});
  driver->execute("PRAGMA cache_size = -2000");  // SQLite's default [kB]
  return std::make_unique<MapStore>(std::move(driver), MapAccess::kWrite);
}

}  // namespace revisit
