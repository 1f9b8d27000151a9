#pragma once

#include <postgresql/libpq-fe.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "postgres_map.h"
#include "sql_driver.h"

namespace revisit::postgres {

struct ServerError : std::runtime_error {
  using std::runtime_error::runtime_error;
  bool is_lost = true;  // the connection
  std::string state;    // postgresql.org/docs/current/errcodes-appendix.html; "": of the connection
};

/// A connection to a server that is reopened when it is lost. Messages begin with the address
/// without its password and never contain the password.
class PostgresDriver : public SqlDriver {
 public:
  /// `listens`: receives notifications by other processes; connects now, without retrying.
  explicit PostgresDriver(Address address, bool listens = true);

  /// Outside of transaction() and retry(), throws ServerError.
  void execute(const std::string& sql, const std::vector<SqlValue>& values = {},
               const Take& take = {}) override;
  void transaction(Locking locking, const std::function<void()>& work) override;
  void notify() override { execute("NOTIFY " + channel_); }
  bool has_updates() override;

  const std::string& map() const { return address_.map; }
  /// Calls `work`, again if the connection is lost. Throws Error if the server stays unavailable or
  /// rejects the work, and UsageError for values it cannot store.
  void retry(const std::function<void()>& work);
  /// Throws the corresponding error, or returns if the connection is lost.
  void throw_unless_lost(const ServerError& error);
  /// Ends the transaction of `hold`, or one that has failed.
  void roll_back();

  /// Set by the work of a transaction that shall last until COMMIT or roll_back(). transaction()
  /// takes part in it.
  bool hold = false;

 private:
  using Result = std::unique_ptr<PGresult, decltype(&PQclear)>;

  void connect();
  Result checked(PGresult* result) const;
  void run_transaction(Locking locking, const std::function<void()>& work, bool again);
  bool was_committed();
  std::string without_password(std::string message) const;

  Address address_;
  bool listens_;
  std::string channel_;
  int64_t id_, transactions_ = 0;  // row of table `writer`
  std::unique_ptr<PGconn, decltype(&PQfinish)> connection_{nullptr, &PQfinish};
};

}  // namespace revisit::postgres
