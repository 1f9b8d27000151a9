#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <pqxx/pqxx>
#include <string>
#include <vector>

#include "postgres_map.h"
#include "sql_driver.h"

namespace revisit::postgres {

/// A connection to a server that is reopened when it is lost. Messages begin with the address
/// without its password and never contain the password.
class PostgresDriver : public SqlDriver {
 public:
  /// `listens`: receives notifications by other processes; connects now, without retrying.
  explicit PostgresDriver(Address address, bool listens = true);
  ~PostgresDriver() override;

  /// Outside of transaction() and retry(), throws what libpqxx throws.
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
  void throw_unless_lost(const pqxx::pqxx_exception& error);
  /// Ends the transaction of `hold`, or one that has failed.
  void roll_back();

  /// True while a transaction begun by execute("BEGIN") lasts; transaction() takes part in it.
  bool hold = false;

 private:
  using Clock = std::chrono::steady_clock;
  class Listener;

  void connect();
  void disconnect();
  void run_transaction(Locking locking, const std::function<void()>& work, bool again);
  bool was_committed();
  void wait_after(const pqxx::pqxx_exception& lost, std::optional<Clock::time_point>& lost_at);
  std::string without_password(std::string message) const;

  Address address_;
  bool listens_;
  std::string channel_;
  int64_t id_, transactions_ = 0;  // row of table `writer`
  std::unique_ptr<pqxx::connection> connection_;
  std::unique_ptr<Listener> listener_;
};

}  // namespace revisit::postgres
