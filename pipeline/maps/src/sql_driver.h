#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "revisit/base/error.h"

namespace revisit {

struct Blob {
  std::string_view bytes;
};
/// Parameter of a statement, or column of a result, without ownership.
using SqlValue = std::variant<std::nullptr_t, int64_t, double, std::string_view, Blob>;

/// Row of a result, valid until the callback of execute() returns. Texts and blobs are one type.
/// The functions throw InputError for a column of another type.
struct SqlRow {
  const std::string& name;      // of the map
  std::vector<SqlValue> cells;  // no Blob

  int64_t integer(size_t column) const { return get<int64_t>(column); }
  std::optional<double> real(size_t column) const {
    if (is_null(column)) return std::nullopt;
    return get<double>(column);
  }
  /// "" for NULL.
  std::string_view bytes(size_t column) const {
    return is_null(column) ? std::string_view() : get<std::string_view>(column);
  }

 private:
  bool is_null(size_t column) const {
    return std::holds_alternative<std::nullptr_t>(cells[column]);
  }
  template <class Type>
  Type get(size_t column) const {
    if (const Type* value = std::get_if<Type>(&cells[column])) return *value;
    throw InputError(name, ": this map is corrupt: a column has a value of another type");
  }
};

/// What differs between the databases, besides the functions of SqlDriver.
struct SqlDialect {
  const char *id, *integer, *real, *blob;  // types of columns
  /// Locks the rows of a SELECT until the commit; "" where a writer locks the whole map.
  const char* for_update;
  /// Statement that locks frames of a drive until the connection or `end_claims`. $1: frames as
  /// {1,2}, $2: drive, $3: maximum number. Rows: the frames. Null: a writer locks the whole map.
  const char *claim, *end_claims;
  const char* integrity_check;  // statement whose rows are problems, or "ok"; null: none
  const char* give_back_space;  // statement outside of transactions; null: done by the server
};

enum class Locking { kReads, kWrites };

/// A connection to the database of a map. Throws the errors of error.h, with the prefix `name`.
class SqlDriver {
 public:
  using Take = std::function<void(const SqlRow&)>;

  SqlDriver(std::string of, const SqlDialect& with) : dialect(with), name_(std::move(of)) {}
  virtual ~SqlDriver() = default;
  SqlDriver(const SqlDriver&) = delete;
  SqlDriver& operator=(const SqlDriver&) = delete;

  /// Executes one statement with the parameters $1, $2, ... `take` may execute others.
  virtual void execute(const std::string& sql, const std::vector<SqlValue>& values = {},
                       const Take& take = {}) = 0;
  /// Calls `work` in a transaction and commits, or rolls back if it throws. Reads see a snapshot.
  /// If the connection is lost, calls `work` again, unless the transaction was committed.
  virtual void transaction(Locking locking, const std::function<void()>& work) = 0;
  /// Tells other processes, on commit, that the map has changed.
  virtual void notify() {}
  /// Returns `updates` after the latest notifications.
  virtual bool has_updates() { return updates; }

  /// Like transaction(), with the result of `work`.
  template <class Work>
  auto run(Locking locking, const Work& work) {
    std::optional<std::invoke_result_t<Work>> result;
    transaction(locking, [&] { result.emplace(work()); });
    return *std::move(result);
  }
  /// First column of the first row.
  std::optional<int64_t> integer(const std::string& sql, const std::vector<SqlValue>& values = {}) {
    std::optional<int64_t> found;
    execute(sql, values, [&](const SqlRow& row) {
      if (!found) found = row.integer(0);
    });
    return found;
  }

  const std::string& name() const { return name_; }
  bool is_shared() const { return *dialect.for_update != '\0'; }  // by several writers
  /// Throws InputError.
  [[noreturn]] void fail_corrupt(const std::string& what) const {
    throw InputError(name_, ": this map is corrupt: ", what,
                     "; restore a copy or build the map again");
  }

  const SqlDialect& dialect;
  bool updates = false;     // others may have changed the map since this was set to false
  int64_t connections = 0;  // number of connections so far; grows after a lost one

 private:
  std::string name_;
};

}  // namespace revisit
