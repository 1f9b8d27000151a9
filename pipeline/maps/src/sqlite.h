#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace revisit::sqlite {

/// A database file that may be untrusted. Throws the errors of error.h, with the prefix `name`.
class Connection {
 public:
  /// `path` must be absolute; `flags` as for sqlite3_open_v2().
  Connection(const std::string& path, int flags, std::string name);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  sqlite3* handle() const { return handle_; }
  const std::string& name() const { return name_; }

  void execute(const std::string& sql);
  /// First column of the first row; 0 or "" if there is no row.
  int64_t integer(const std::string& sql);
  std::string text(const std::string& sql);

  [[noreturn]] void fail(int code) const;
  /// Throws InputError.
  [[noreturn]] void fail_corrupt(const std::string& what) const;
  std::string content();

 private:
  void harden();

  sqlite3* handle_ = nullptr;
  std::string name_;
};

class Statement {
 public:
  Statement(Connection& connection, const std::string& sql);
  ~Statement();
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  // As in SQLite, columns count from 0 and parameters from 1. A bound value must live until step().
  Statement& bind(int parameter, int64_t value);
  Statement& bind(int parameter, double value);
  Statement& bind(int parameter, std::string_view text);
  Statement& bind_blob(int parameter, std::string_view bytes);
  Statement& bind_null(int parameter);
  Statement& reset();

  /// Returns false after the last row.
  bool step();

  int type(int column) { return sqlite3_column_type(statement_, column); }
  int64_t integer(int column) { return sqlite3_column_int64(statement_, column); }
  double real(int column) { return sqlite3_column_double(statement_, column); }
  /// Text or blob, valid until the next step(). Throws std::bad_alloc.
  std::string_view bytes(int column);

 private:
  void check(int code) const;

  Connection& connection_;
  sqlite3_stmt* statement_ = nullptr;
};

enum class Locking { kReads, kWrites };

/// Rolls back in the destructor unless commit() was called.
class Transaction {
 public:
  Transaction(Connection& connection, Locking locking);
  ~Transaction();
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void commit();

 private:
  Connection& connection_;
};

}  // namespace revisit::sqlite
