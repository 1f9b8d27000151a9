#include "sqlite.h"

#include <cstring>
#include <memory>
#include <new>

#include "map_format.h"
#include "revisit/base/error.h"

namespace revisit::sqlite {
namespace {

// A writer commits within milliseconds; a longer lock means that a program holds the map.
constexpr int kPatience = 3000;  // [ms]

}  // namespace

Connection::Connection(const std::string& path, int flags, std::string name)
    : name_(std::move(name)) {
  const int code = sqlite3_open_v2(path.c_str(), &handle_, flags | SQLITE_OPEN_EXRESCODE, nullptr);
  try {
    if (code != SQLITE_OK) fail(code);
    harden();
  } catch (...) {
    sqlite3_close_v2(handle_);
    throw;
  }
}

Connection::~Connection() {
  sqlite3_close_v2(handle_);
}

// https://www.sqlite.org/security.html
void Connection::harden() {
  sqlite3_busy_timeout(handle_, kPatience);
  sqlite3_db_config(handle_, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_db_config(handle_, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  sqlite3_db_config(handle_, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, nullptr);
  sqlite3_db_config(handle_, SQLITE_DBCONFIG_ENABLE_VIEW, 0, nullptr);
  sqlite3_limit(handle_, SQLITE_LIMIT_LENGTH, kMaxBytes);
  sqlite3_limit(handle_, SQLITE_LIMIT_SQL_LENGTH, 10'000);
  sqlite3_limit(handle_, SQLITE_LIMIT_COLUMN, 100);
  sqlite3_limit(handle_, SQLITE_LIMIT_EXPR_DEPTH, 10);
  sqlite3_limit(handle_, SQLITE_LIMIT_COMPOUND_SELECT, 3);
  sqlite3_limit(handle_, SQLITE_LIMIT_VDBE_OP, 25'000);
  sqlite3_limit(handle_, SQLITE_LIMIT_ATTACHED, 0);
  execute("PRAGMA cell_size_check = ON");
}

void Connection::execute(const std::string& sql) {
  Statement statement(*this, sql);
  while (statement.step()) continue;
}

int64_t Connection::integer(const std::string& sql) {
  Statement statement(*this, sql);
  return statement.step() ? statement.integer(0) : 0;
}

std::string Connection::text(const std::string& sql) {
  Statement statement(*this, sql);
  return std::string(statement.step() ? statement.bytes(0) : "");
}

void Connection::fail(int code) const {
  const int system_error = handle_ == nullptr ? 0 : sqlite3_system_errno(handle_);
  const std::string reason = system_error == 0
                                 ? std::string(sqlite3_errstr(code))
                                 : str(sqlite3_errstr(code), ": ", std::strerror(system_error));
  switch (code & 0xFF) {
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      throw Error(name_, ": another process is writing to this map; wait for it to end");
    case SQLITE_CANTOPEN:
    case SQLITE_PERM:
      throw Error(name_, ": cannot be opened: ", reason);
    case SQLITE_READONLY:
      throw Error(name_, ": cannot be written: no permission, or a read-only file system");
    case SQLITE_FULL:
      throw Error(str(name_, ": cannot be written: the disk is full; earlier changes are kept"));
    case SQLITE_IOERR:
      throw Error(name_, ": cannot be read or written: ", reason);
    case SQLITE_NOTADB:
      throw InputError(
          str(name_, ": not a map, or its first bytes are corrupt: not a SQLite ", "database"));
    case SQLITE_NOMEM:
      throw std::bad_alloc();
    default:
      fail_corrupt(reason);
  }
}

void Connection::fail_corrupt(const std::string& what) const {
  throw InputError(
      str(name_, ": this map is corrupt: ", what, "; restore a copy or build the map again"));
}

std::string Connection::content() {
  sqlite3_int64 size = 0;
  const std::unique_ptr<unsigned char, decltype(&sqlite3_free)> bytes(
      sqlite3_serialize(handle_, "main", &size, 0), &sqlite3_free);
  if (bytes == nullptr) throw std::bad_alloc();
  return {reinterpret_cast<const char*>(bytes.get()), static_cast<size_t>(size)};
}

Statement::Statement(Connection& connection, const std::string& sql) : connection_(connection) {
  check(sqlite3_prepare_v2(connection.handle(), sql.c_str(), -1, &statement_, nullptr));
}

Statement::~Statement() {
  sqlite3_finalize(statement_);
}

void Statement::check(int code) const {
  if (code != SQLITE_OK) connection_.fail(code);
}

Statement& Statement::bind(int parameter, int64_t value) {
  check(sqlite3_bind_int64(statement_, parameter, value));
  return *this;
}

Statement& Statement::bind(int parameter, double value) {
  check(sqlite3_bind_double(statement_, parameter, value));
  return *this;
}

Statement& Statement::bind(int parameter, std::string_view text) {
  // A null pointer would bind NULL.
  check(sqlite3_bind_text64(statement_, parameter, text.empty() ? "" : text.data(), text.size(),
                            SQLITE_STATIC, SQLITE_UTF8));
  return *this;
}

Statement& Statement::bind_blob(int parameter, std::string_view bytes) {
  check(sqlite3_bind_blob64(statement_, parameter, bytes.empty() ? "" : bytes.data(), bytes.size(),
                            SQLITE_STATIC));
  return *this;
}

Statement& Statement::bind_null(int parameter) {
  check(sqlite3_bind_null(statement_, parameter));
  return *this;
}

Statement& Statement::reset() {
  sqlite3_reset(statement_);  // returns the error of step() again
  return *this;
}

bool Statement::step() {
  const int code = sqlite3_step(statement_);
  if (code != SQLITE_ROW && code != SQLITE_DONE) connection_.fail(code);
  return code == SQLITE_ROW;
}

std::string_view Statement::bytes(int column) {
  const void* data = sqlite3_column_blob(statement_, column);
  const int size = sqlite3_column_bytes(statement_, column);
  if (data == nullptr && size > 0) throw std::bad_alloc();
  return {static_cast<const char*>(data), static_cast<size_t>(size)};
}

Transaction::Transaction(Connection& connection, Locking locking) : connection_(connection) {
  connection_.execute(locking == Locking::kWrites ? "BEGIN IMMEDIATE" : "BEGIN");
}

Transaction::~Transaction() {
  // SQLite has rolled back by itself after some errors.
  if (sqlite3_get_autocommit(connection_.handle()) == 0)
    sqlite3_exec(connection_.handle(), "ROLLBACK", nullptr, nullptr, nullptr);
}

void Transaction::commit() {
  connection_.execute("COMMIT");
}

}  // namespace revisit::sqlite
