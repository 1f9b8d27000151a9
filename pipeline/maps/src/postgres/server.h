#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <pqxx/pqxx>
#include <string>

#include "address.h"

namespace revisit::pipeline::postgres {

/// A connection to a server, made again when it is lost. Errors are ours (error.h), begin with
/// the address without its password, and never have the password.
class Server {
 public:
  /// Connects. Throws as run() does, and without patience.
  explicit Server(Address address);
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  const std::string& name() const { return address_.name; }
  const std::string& map() const { return address_.map; }

  /// Calls `work(connection)` and returns what it does. When the connection is lost meanwhile, even
  /// during a commit, `work` is called again with another: it has to find out what it has done.
  /// Throws Error when the server stays away or refuses, UsageError for what it cannot keep.
  template <class Work>
  auto run(Work&& work) {
    for (std::optional<Clock::time_point> lost_at;;) {
      try {
        return work(connected());
      } catch (const pqxx::pqxx_exception& error) {
        after(error, lost_at);
      }
    }
  }

  /// Tells others that this transaction changes the map.
  void tell_others(pqxx::transaction_base& step) const;
  /// Whether others have told so, or may have while the connection was lost.
  bool was_told(std::chrono::milliseconds wait);
  void forget_news() { news_ = false; }

 private:
  using Clock = std::chrono::steady_clock;
  class Listener;

  pqxx::connection& connected();
  void connect();
  /// Returns when the work is to be tried again, else throws.
  void after(const pqxx::pqxx_exception& error, std::optional<Clock::time_point>& lost_at);
  std::string without_password(std::string message) const;

  Address address_;
  std::string channel_;
  std::unique_ptr<pqxx::connection> connection_;
  std::unique_ptr<Listener> listener_;
  bool news_ = true;  // whatever happened before there was a connection
};

}  // namespace revisit::pipeline::postgres
