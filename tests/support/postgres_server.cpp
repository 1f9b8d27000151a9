#include "postgres_server.h"

#include <pwd.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <thread>

namespace revisit::test {
namespace {

namespace fs = std::filesystem;

/// Debian has one folder per version.
fs::path programs() {
  fs::path found;
  if (fs::exists("/usr/lib/postgresql"))
    for (const auto& version : fs::directory_iterator("/usr/lib/postgresql"))
      if (fs::exists(version.path() / "bin/postgres")) found = version.path() / "bin";
  return found;
}

std::string as_user() {
  return ::geteuid() == 0 ? "setpriv --reuid=postgres --regid=postgres --clear-groups " : "";
}

std::string output_of(const std::string& command, int& status) {
  FILE* pipe = ::popen((command + " 2>&1").c_str(), "r");
  std::string output;
  char buffer[1000];
  while (const size_t n = std::fread(buffer, 1, sizeof(buffer), pipe)) output.append(buffer, n);
  status = ::pclose(pipe);
  return output;
}

std::string run(const std::string& command) {
  int status = 0;
  std::string output = output_of(command, status);
  if (status != 0) throw std::runtime_error(command + ": " + output);
  return output;
}

}  // namespace

std::string PostgresServer::missing() {
#ifndef REVISIT_HAVE_POSTGRES
  return "built without libpq";
#endif
  if (programs().empty()) return "no PostgreSQL server is installed (postgresql)";
  if (::geteuid() == 0 && ::getpwnam("postgres") == nullptr) return "there is no user postgres";
  return "";
}

PostgresServer::PostgresServer() {
  fs::permissions(folder_.path(), fs::perms(0755));
  fs::create_directory(folder_ / "server");
  if (::geteuid() == 0) run("chown postgres " + (folder_ / "server").string());
  run("cd / && " + as_user() + (programs() / "initdb").string() +
      " --no-sync --no-locale -E UTF8 -A trust -U postgres -D " + (folder_ / "server").string());
  write_file(folder_ / "server/pg_hba.conf",
             "local all guest scram-sha-256\nlocal all all trust\n");
  start();
}

PostgresServer::~PostgresServer() {
  if (process_ > 0) kill();
}

std::string PostgresServer::url(const std::string& map, const std::string& user,
                                const std::string& database) const {
  return "postgresql://" + user + "@/" + database + "?host=" + (folder_ / "server").string() +
         "&map=" + map + "&patience=20";
}

std::string PostgresServer::execute(const std::string& sql) const {
  write_file(folder_ / "sql", sql);
  return run("psql -h " + (folder_ / "server").string() +
             " -U postgres -XqtA -v ON_ERROR_STOP=1 -f " + (folder_ / "sql").string());
}

PostgresServer& PostgresServer::without_maps() {
  static PostgresServer server;
  server.start();  // the preceding test may have killed it
  server.execute(
      "DO $$ DECLARE name text; BEGIN FOR name IN SELECT nspname FROM pg_namespace WHERE nspname "
      "!~ "
      "'^pg_' AND nspname NOT IN ('information_schema', 'public') LOOP EXECUTE 'DROP SCHEMA ' || "
      "quote_ident(name) || ' CASCADE'; END LOOP; END $$");
  return server;
}

void PostgresServer::start() {
  const std::string data = (folder_ / "server").string();
  const std::string command =
      "cd / && exec " + as_user() + (programs() / "postgres").string() + " -D " + data + " -k " +
      data + " -c listen_addresses= -c shared_buffers=16MB -c recovery_init_sync_method=syncfs >>" +
      (folder_ / "log").string() + " 2>&1";
  // After a kill, a start fails until the earlier processes have ended.
  for (int i = 0; i < 300; ++i) {
    if (process_ <= 0 || ::waitpid(process_, nullptr, WNOHANG) == process_) {
      process_ = ::fork();
      if (process_ == 0) {
        ::execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
        std::_Exit(1);
      }
    }
    int status = 0;
    output_of((programs() / "pg_isready").string() + " -q -h " + data, status);
    if (status == 0) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  throw std::runtime_error("the server does not start: " + read_file(folder_ / "log"));
}

void PostgresServer::kill() {
  ::kill(process_, SIGKILL);
  ::waitpid(process_, nullptr, 0);
  process_ = -1;
}

void PostgresServer::restart() {
  kill();
  start();
}

void PostgresServer::close_connections(const std::string& which) const {
  execute(
      "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid() AND " +
      which);
}

}  // namespace revisit::test
