#pragma once

#include <sys/types.h>

#include <string>

#include "testing.h"

namespace revisit::test {

/// A PostgreSQL server in a temporary folder, with a Unix socket only. Runs as user postgres if the
/// tests run as root, which the server rejects.
class PostgresServer {
 public:
  /// Returns "" if a server is installed, else the reason.
  static std::string missing();

  /// Returns the server that the tests of this program share, because starting it takes seconds. It
  /// runs and has no maps.
  static PostgresServer& without_maps();

  PostgresServer();
  ~PostgresServer();
  PostgresServer(const PostgresServer&) = delete;
  PostgresServer& operator=(const PostgresServer&) = delete;

  /// URL of a map. `user`: NAME or NAME:PASSWORD.
  std::string url(const std::string& map, const std::string& user = "postgres",
                  const std::string& database = "postgres") const;
  std::string execute(const std::string& sql) const;

  void start();
  /// Sends SIGKILL; child processes end when they notice.
  void kill();
  void restart();
  /// `which`: condition on a row of pg_stat_activity.
  void close_connections(const std::string& which) const;

 private:
  TempDir folder_;
  pid_t process_ = -1;
};

}  // namespace revisit::test
