#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <pqxx/pqxx>
#include <string>

#include "server_address.h"

namespace revisit::pipeline::postgres {

/// A connection to a server, made again when it is lost. Errors are ours (error.h), begin with
/// the address without its password, and never have the password.
class Server {
 public:
  /// `listens`, to what others tell: connects at once. Throws as run() does, and without patience.
  /// Else the first run() connects.
  explicit Server(Address address, bool listens = true);
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  const std::string& name() const { return address_.name; }
  const std::string& map() const { return address_.map; }

  /// Calls `work(connection)` and returns what it does. When the connection is lost meanwhile, even
  /// during a commit, `work` is called again with another: it has to find out what it has done.
  /// Throws Error when the server stays away or refuses, UsageError for what it cannot store.
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

  /// For errors of libpqxx outside of run(): throws what they mean, and returns when the connection
  /// is lost, which no transaction may be using any more. The next run() makes another.
  void throw_unless_lost(const pqxx::pqxx_exception& error);

  /// Tells others that this transaction changes the map.
  void tell_others(pqxx::transaction_base& step) const;
  /// Whether others have told so, or may have while the connection was lost.
  bool was_told();
  void forget_news() { news_ = false; }
  /// Not all that was told was read.
  void has_more_news() { news_ = true; }

 private:
  using Clock = std::chrono::steady_clock;
  class Listener;

  pqxx::connection& connected();
  void connect();
  /// Returns when the work is to be tried again, else throws.
  void wait_after(const pqxx::pqxx_exception& lost, std::optional<Clock::time_point>& lost_at);
  std::string without_password(std::string message) const;

  Address address_;
  bool listens_;
  std::string channel_;
  std::unique_ptr<pqxx::connection> connection_;
  std::unique_ptr<Listener> listener_;
  bool news_ = true;  // whatever happened before there was a connection
};

}  // namespace revisit::pipeline::postgres
