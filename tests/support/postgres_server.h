#pragma once

#include <sys/types.h>

#include <string>

#include "test_data.h"

namespace revisit::test {

/// A PostgreSQL server in a temporary folder, which only a socket there leads to. It runs as the
/// user postgres when the tests are run by root, which the server refuses.
class PostgresServer {
 public:
  /// "" when there is one to start, else why not.
  static std::string missing();

  PostgresServer();
  ~PostgresServer();
  PostgresServer(const PostgresServer&) = delete;
  PostgresServer& operator=(const PostgresServer&) = delete;

  /// The address of a map there. `user`: with a password, as NAME:PASSWORD.
  std::string url(const std::string& map, const std::string& user = "postgres",
                  const std::string& database = "postgres") const;
  /// Runs SQL with psql; returns what it printed.
  std::string execute(const std::string& sql) const;

  /// Drops every schema of the database that is not the server's own.
  void forget_maps() const;

  /// Does nothing when it runs.
  void start();
  /// With SIGKILL; its own processes end when they notice.
  void kill();

 private:
  TempDir folder_;
  pid_t process_ = -1;
};

}  // namespace revisit::test
