#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace revisit::pipeline::sqlite {

/// The largest text or blob, and nearly the largest row, [bytes].
constexpr int kMostBytes = 256 << 20;

/// A database that is trusted no further than a stranger's file. Errors are ours (error.h) and
/// begin with `name`, the file as the user knows it.
class Connection {
 public:
  /// Opens `path`, which is absolute; `flags` as for sqlite3_open_v2().
  Connection(const std::string& path, int flags, std::string name);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  sqlite3* handle() const { return handle_; }
  const std::string& name() const { return name_; }

  void execute(const std::string& sql);
  /// The first column of the first row, 0 and "" when there is none.
  int64_t integer(const std::string& sql);
  std::string text(const std::string& sql);

  /// Throws the error for a result code of SQLite.
  [[noreturn]] void fail(int code) const;
  /// Throws InputError that says what is damaged, and what to do.
  [[noreturn]] void fail_damaged(const std::string& what) const;
  /// The bytes of the file.
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

  // Columns and parameters count from 1 and 0, as SQLite has it. What is bound must live until
  // step().
  Statement& bind(int parameter, int64_t value);
  Statement& bind(int parameter, double value);
  Statement& bind(int parameter, std::string_view text);
  Statement& bind_blob(int parameter, std::string_view bytes);
  Statement& bind_null(int parameter);
  Statement& reset();

  /// Whether there is a row; throws.
  bool step();

  /// SQLITE_INTEGER, SQLITE_NULL, ...
  int type(int column) { return sqlite3_column_type(statement_, column); }
  int64_t integer(int column) { return sqlite3_column_int64(statement_, column); }
  double real(int column) { return sqlite3_column_double(statement_, column); }
  /// A text or blob, until the next step. Throws std::bad_alloc.
  std::string_view bytes(int column);

 private:
  void check(int code) const;

  Connection& connection_;
  sqlite3_stmt* statement_ = nullptr;
};

enum class Locking { kReads, kWrites };

/// All or nothing: rolled back unless committed.
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

}  // namespace revisit::pipeline::sqlite
