#pragma once

#include <sqlite3.h>

#include <memory>
#include <string>
#include <vector>

#include "sql_driver.h"

namespace revisit {

extern const SqlDialect kSqlite;

/// A database file that may be untrusted.
class SqliteDriver : public SqlDriver {
 public:
  /// `path` must be absolute; `flags` as for sqlite3_open_v2(). `lock`: lock_writer(); null
  /// for a reader.
  SqliteDriver(const std::string& path, int flags, std::string name,
               std::shared_ptr<const int> lock = nullptr);
  ~SqliteDriver() override;

  void execute(const std::string& sql, const std::vector<SqlValue>& values = {},
               const Take& take = {}) override;
  void transaction(Locking locking, const std::function<void()>& work) override;
  bool has_updates() override;

  sqlite3* handle() const { return handle_; }
  [[noreturn]] void fail(int code) const;

 private:
  void harden();

  std::shared_ptr<const int> lock_;  // released after the connection
  sqlite3* handle_ = nullptr;
  int owner_;             // process
  int64_t version_ = -1;  // PRAGMA data_version of the latest has_updates()
};

}  // namespace revisit
