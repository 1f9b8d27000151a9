#include "map_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "sqlite_tables.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;
using sqlite::Connection;

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

constexpr uint64_t kHeaderBytes = 32, kFrameHeaderBytes = 24;

uint32_t big_endian(const uint8_t* bytes) {
  return uint32_t{bytes[0]} << 24 | uint32_t{bytes[1]} << 16 | uint32_t{bytes[2]} << 8 | bytes[3];
}

/// SQLite's cumulative checksum over pairs of 32-bit words.
struct Checksum32 {
  bool words_are_big_endian = false;
  uint32_t first = 0, second = 0;

  void add(std::span<const uint8_t> bytes) {
    const auto word = [this](const uint8_t* at) {
      const uint32_t big = big_endian(at);
      return words_are_big_endian ? big : __builtin_bswap32(big);
    };
    for (size_t i = 0; i + 8 <= bytes.size(); i += 8) {
      first += word(&bytes[i]) + second;
      second += word(&bytes[i + 4]) + first;
    }
  }
  bool is(const uint8_t* stored) const {
    return first == big_endian(stored) && second == big_endian(stored + 4);
  }
};

struct Defect {
  uint64_t offset = 0;  // of the first corrupt frame [bytes]
  int64_t steps = 0;
};

std::optional<Defect> find_defect(const std::filesystem::path& path) {
  FileCursor file(path);
  if (file.size() < kHeaderBytes) return std::nullopt;
  std::array<uint8_t, kHeaderBytes> header{};
  file.read(header.data(), header.size());
  const uint32_t page = big_endian(&header[8]);
  if (page < 512 || page > 65536 || (page & (page - 1)) != 0) return Defect{0, 2};
  Checksum32 sum{.words_are_big_endian = (header[3] & 1) != 0};
  sum.add(std::span(header).first(24));
  std::optional<Defect> defect;
  if (!sum.is(&header[24])) defect.emplace();
  std::vector<uint8_t> frame(kFrameHeaderBytes + page);
  for (uint64_t at = kHeaderBytes; at + frame.size() <= file.size(); at += frame.size()) {
    file.read(frame.data(), frame.size());
    const bool of_this_log = std::equal(&frame[8], &frame[16], &header[16]);
    sum.add(std::span(frame).first(8));
    sum.add(std::span(frame).subspan(kFrameHeaderBytes));
    if (!defect && (!of_this_log || !sum.is(&frame[16]))) defect.emplace(Defect{at, 0});
    if (defect && of_this_log && big_endian(&frame[4]) != 0) ++defect->steps;
  }
  return defect;
}

}  // namespace

WriterLock::WriterLock(const std::filesystem::path& map, const std::string& name)
    : file_(map.string() + "-writer") {
  while (true) {
    descriptor_ = ::open(file_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
    if (descriptor_ < 0)
      throw Error(name, ": cannot be written: ", file_.filename().string(), ": ",
                  std::strerror(errno));
    const bool locked = ::flock(descriptor_, LOCK_EX | LOCK_NB) == 0;
    if (locked && is_named(descriptor_, file_)) return;  // a writer that ends removes it
    const int reason = errno;
    ::close(descriptor_);
    if (locked) continue;
    if (reason == EWOULDBLOCK)
      throw Error(name, ": another process is writing to this map; wait for it to end");
    throw Error(name, ": cannot be locked: ", std::strerror(reason));
  }
}

WriterLock::~WriterLock() {
  ::unlink(file_.c_str());
  ::close(descriptor_);
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
  const uintmax_t found = fs::file_size(log(), none);
  return none ? 0 : found;
}

void MapFile::check_is_a_map() const {
  const Connection found(immutable_uri(path_), SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, name_);
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

void MapFile::check_log() const {
  if (!fs::exists(log())) return;
  // A writer may be appending frames: unfinished ones are valid at the second attempt.
  if (const auto seen = find_defect(log()); !seen || seen->steps < 2) return;
  const auto defect = find_defect(log());
  if (!defect || defect->steps < 2) return;
  throw InputError(
      name_, "-wal: corrupt at byte ", defect->offset, "; ", defect->steps,
      " transactions after it cannot be read; restore a copy of the map, or move this file "
      "away to continue without them");
}

void MapFile::make(const MapHeader& header) const {
  if (bytes_of_log() > 0) throw InputError(name_, "-wal: a log without its map; move it away");
  Connection map(":memory:", SQLITE_OPEN_READWRITE, name_);
  make_tables(map, header);
  std::string bytes = map.content();
  bytes[18] = bytes[19] = 2;  // WAL mode: https://www.sqlite.org/fileformat2.html#vnums
  write_atomically(path_, [&](std::ostream& out) { out << bytes; });
}

std::unique_ptr<Connection> MapFile::open_for_reading() const {
  const bool may_write_beside = ::access(path_.parent_path().c_str(), W_OK) == 0;
  auto connection = std::make_unique<Connection>(path_, SQLITE_OPEN_READONLY, name_);
  const int code =
      sqlite3_exec(connection->handle(), "SELECT 1 FROM sqlite_schema", nullptr, nullptr, nullptr);
  const int kind = code & 0xFF;
  if (code == SQLITE_OK) return connection;
  // Readers of a log share memory in FILE-shm, which this process cannot create.
  if (may_write_beside || (kind != SQLITE_CANTOPEN && kind != SQLITE_READONLY))
    connection->fail(code);
  if (bytes_of_log() > 0)
    throw Error(name_, "-wal: its entries cannot be read, because the folder cannot be written; ",
                "copy both files to another folder");
  return std::make_unique<Connection>(immutable_uri(path_), SQLITE_OPEN_READONLY | SQLITE_OPEN_URI,
                                      name_);
}

std::unique_ptr<Connection> MapFile::open_for_writing() const {
  auto connection = std::make_unique<Connection>(path_, SQLITE_OPEN_READWRITE, name_);
  if (sqlite3_db_readonly(connection->handle(), nullptr) != 0) connection->fail(SQLITE_READONLY);
  check_schema(*connection);
  if (const std::string mode = connection->text("PRAGMA journal_mode = WAL"); mode != "wal")
    throw Error(name_, ": this file system has no shared memory for SQLite's log (", mode,
                " instead of WAL); use a local disk");
  connection->execute("PRAGMA synchronous = FULL");  // commits are durable
  return connection;
}

}  // namespace revisit
