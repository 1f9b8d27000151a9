#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <pqxx/pqxx>
#include <string>

#include "postgres_map.h"

namespace revisit::postgres {

/// A connection to a server that is reopened when it is lost. Throws the errors of error.h;
/// messages begin with the address without its password and never contain the password.
class Server {
 public:
  /// `listens`: receives notifications by other processes; connects immediately and throws like
  /// run(), without retrying. Otherwise the first run() connects.
  explicit Server(Address address, bool listens = true);
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  const std::string& name() const { return address_.name; }
  const std::string& map() const { return address_.map; }

  /// Calls `work(connection)` and returns its result. If the connection is lost, even during a
  /// commit, `work` is called again with a new connection and must find out what it has done.
  /// Throws Error if the server stays unavailable or rejects the work, and UsageError for values it
  /// cannot store.
  template <class Work>
  auto run(Work&& work) {
    for (std::optional<Clock::time_point> lost_at;;) {
      try {
        return work(connected());
      } catch (const pqxx::pqxx_exception& error) {
        throw_unless_lost(error);
        wait_after(error, lost_at);
      }
    }
  }

  /// Handles errors of libpqxx outside of run(): throws the corresponding error, or returns if the
  /// connection is lost. In that case no transaction may use it, and the next run() opens another.
  void throw_unless_lost(const pqxx::pqxx_exception& error);

  /// Takes effect on commit.
  void notify_others(pqxx::transaction_base& step) const;
  /// True if others sent a notification, or may have while the connection was lost.
  bool has_notifications();
  void clear_updates() { updates_ = false; }
  /// Call if notified changes were not read completely.
  void keep_updates() { updates_ = true; }

 private:
  using Clock = std::chrono::steady_clock;
  class Listener;

  pqxx::connection& connected();
  void connect();
  void wait_after(const pqxx::pqxx_exception& lost, std::optional<Clock::time_point>& lost_at);
  std::string without_password(std::string message) const;

  Address address_;
  bool listens_;
  std::string channel_;
  std::unique_ptr<pqxx::connection> connection_;
  std::unique_ptr<Listener> listener_;
  bool updates_ = true;  // changes before the connection are unknown
};

}  // namespace revisit::postgres
