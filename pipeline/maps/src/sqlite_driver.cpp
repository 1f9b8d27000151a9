#include "sqlite_driver.h"

#include <unistd.h>

#include <cstring>
#include <new>

#include "map_format.h"
#include "revisit/base/error.h"

namespace revisit {
namespace {

// A writer commits within milliseconds; a longer lock means that a program holds the map.
constexpr int kPatience = 3000;  // [ms]

using Statement = std::unique_ptr<sqlite3_stmt, decltype(&sqlite3_finalize)>;

int bind(sqlite3_stmt* statement, int parameter, const SqlValue& value) {
  if (const auto* integer = std::get_if<int64_t>(&value))
    return sqlite3_bind_int64(statement, parameter, *integer);
  if (const auto* real = std::get_if<double>(&value))
    return sqlite3_bind_double(statement, parameter, *real);
  // A null pointer would bind NULL.
  if (const auto* text = std::get_if<std::string_view>(&value))
    return sqlite3_bind_text64(statement, parameter, text->empty() ? "" : text->data(),
                               text->size(), SQLITE_STATIC, SQLITE_UTF8);
  if (const auto* blob = std::get_if<Blob>(&value))
    return sqlite3_bind_blob64(statement, parameter, blob->bytes.empty() ? "" : blob->bytes.data(),
                               blob->bytes.size(), SQLITE_STATIC);
  return sqlite3_bind_null(statement, parameter);
}

void read_row(sqlite3_stmt* statement, SqlRow& row) {
  row.cells.assign(static_cast<size_t>(sqlite3_column_count(statement)), nullptr);
  for (int column = 0; column < std::ssize(row.cells); ++column) {
    auto& cell = row.cells[static_cast<size_t>(column)];
    switch (sqlite3_column_type(statement, column)) {
      case SQLITE_NULL:
        break;
      case SQLITE_INTEGER:
        cell = int64_t{sqlite3_column_int64(statement, column)};
        break;
      case SQLITE_FLOAT:
        cell = sqlite3_column_double(statement, column);
        break;
      default: {
        const void* data = sqlite3_column_blob(statement, column);
        const int size = sqlite3_column_bytes(statement, column);
        if (data == nullptr && size > 0) throw std::bad_alloc();
        cell = std::string_view(static_cast<const char*>(data), static_cast<size_t>(size));
      }
    }
  }
}

}  // namespace

const SqlDialect kSqlite{.id = "INTEGER PRIMARY KEY",
                         .integer = "INTEGER",
                         .real = "REAL",
                         .blob = "BLOB",
                         .for_update = "",
                         .claim = nullptr,
                         .end_claims = nullptr,
                         // Beyond the tables: free pages and inner pages of the trees.
                         .integrity_check = "PRAGMA integrity_check(20)",
                         .give_back_space = "VACUUM"};

SqliteDriver::SqliteDriver(const std::string& path, int flags, std::string name,
                           std::shared_ptr<const int> lock)
    : SqlDriver(std::move(name), kSqlite), lock_(std::move(lock)), owner_(::getpid()) {
  const int code = sqlite3_open_v2(path.c_str(), &handle_, flags | SQLITE_OPEN_EXRESCODE, nullptr);
  try {
    if (code != SQLITE_OK) fail(code);
    harden();
  } catch (...) {
    sqlite3_close_v2(handle_);
    throw;
  }
}

SqliteDriver::~SqliteDriver() {
  if (::getpid() != owner_) return;  // a forked child; closing would release the parent's locks
  // Then the file has all entries, also if readers keep the log.
  if (lock_ != nullptr)
    sqlite3_wal_checkpoint_v2(handle_, nullptr, SQLITE_CHECKPOINT_PASSIVE, nullptr, nullptr);
  sqlite3_close_v2(handle_);
}

// https://www.sqlite.org/security.html
void SqliteDriver::harden() {
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
  sqlite3_limit(handle_, SQLITE_LIMIT_ATTACHED, 1);  // VACUUM attaches a copy
  SqliteDriver::execute("PRAGMA cell_size_check = ON");
}

void SqliteDriver::execute(const std::string& sql, const std::vector<SqlValue>& values,
                           const Take& take) {
  sqlite3_stmt* prepared = nullptr;
  const auto check = [&](int code) {
    if (code != SQLITE_OK) fail(code);
  };
  check(sqlite3_prepare_v2(handle_, sql.c_str(), -1, &prepared, nullptr));
  const Statement statement(prepared, &sqlite3_finalize);
  for (size_t i = 0; i < values.size(); ++i)  // $2 may come before $1
    check(
        bind(prepared, sqlite3_bind_parameter_index(prepared, str("$", i + 1).c_str()), values[i]));
  SqlRow row{name(), {}};
  int code = SQLITE_ROW;
  while ((code = sqlite3_step(prepared)) == SQLITE_ROW) {
    if (!take) continue;
    read_row(prepared, row);
    take(row);
  }
  if (code != SQLITE_DONE) fail(code);
}

void SqliteDriver::transaction(Locking locking, const std::function<void()>& work) {
  if (locking == Locking::kWrites && ::getpid() != owner_)  // sqlite.org/howtocorrupt.html, 2.6
    throw Error(name(), ": the process that opened this map forked; open the map again");
  int is_gone = 0;
  if (locking == Locking::kWrites && lock_ != nullptr &&
      sqlite3_file_control(handle_, "main", SQLITE_FCNTL_HAS_MOVED, &is_gone) == SQLITE_OK &&
      is_gone != 0)
    throw Error(name(), ": the file was moved or deleted while it was open; open the map again");
  execute(locking == Locking::kWrites ? "BEGIN IMMEDIATE" : "BEGIN");
  try {
    work();
    execute("COMMIT");
  } catch (...) {
    // SQLite has rolled back by itself after some errors.
    if (sqlite3_get_autocommit(handle_) == 0)
      sqlite3_exec(handle_, "ROLLBACK", nullptr, nullptr, nullptr);
    throw;
  }
}

bool SqliteDriver::has_updates() {
  const int64_t before = version_;
  version_ = integer("PRAGMA data_version").value_or(0);  // changes with commits of others
  return updates = updates || version_ != before;
}

void SqliteDriver::fail(int code) const {
  const int system_error = handle_ == nullptr ? 0 : sqlite3_system_errno(handle_);
  const std::string reason = system_error == 0
                                 ? std::string(sqlite3_errstr(code))
                                 : str(sqlite3_errstr(code), ": ", std::strerror(system_error));
  switch (code & 0xFF) {
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      throw Error(name(), ": another process is writing to this map; wait for it to end");
    case SQLITE_CANTOPEN:
    case SQLITE_PERM:
      throw Error(name(), ": cannot be opened: ", reason);
    case SQLITE_READONLY:
      throw Error(name(), ": cannot be written: no permission, or a read-only file system");
    case SQLITE_FULL:
      throw Error(name(), ": cannot be written: the disk is full",
                  lock_ == nullptr ? "" : "; earlier changes are kept");
    case SQLITE_IOERR:
      throw Error(name(), ": cannot be read or written: ", reason);
    case SQLITE_NOTADB:
      throw InputError(name(),
                       ": not a map, or its first bytes are corrupt: not a SQLite database");
    case SQLITE_NOMEM:
      throw std::bad_alloc();
    default:
      fail_corrupt(reason);
  }
}

}  // namespace revisit
