#include "server.h"

#include <thread>

#include "revisit/base/error.h"

namespace revisit::postgres {
namespace {

constexpr std::chrono::milliseconds kBetweenTries{100};

bool has(const std::string& text, const char* part) {
  return text.find(part) != std::string::npos;
}

std::string remedy_of(const std::string& message) {
  if (has(message, "does not exist") && has(message, "database"))
    return "create the database with `createdb`";
  if (has(message, "password") || has(message, "authentication") || has(message, "role"))
    return "check the user and the password in the address, in PGPASSWORD or in ~/.pgpass";
  return "check that a PostgreSQL server runs there and accepts connections from this machine";
}

template <class Kind>
bool is(const pqxx::pqxx_exception& error) {
  return dynamic_cast<const Kind*>(&error) != nullptr;
}

bool means_lost(const pqxx::pqxx_exception& error) {
  if (is<pqxx::broken_connection>(error) || is<pqxx::in_doubt_error>(error) ||
      is<pqxx::statement_completion_unknown>(error))
    return true;
  const auto* sql = dynamic_cast<const pqxx::sql_error*>(&error);
  // 57P..: the server shuts down or starts; 08...: the connection failed.
  return sql != nullptr &&
         (sql->sqlstate().starts_with("57P") || sql->sqlstate().starts_with("08"));
}

}  // namespace

class Server::Listener : public pqxx::notification_receiver {
 public:
  Listener(pqxx::connection& connection, const std::string& channel, bool& updates)
      : notification_receiver(connection, channel), updates_(updates) {}
  void operator()(const std::string&, int process) override {
    if (process != conn().backendpid()) updates_ = true;
  }

 private:
  bool& updates_;
};

Server::Server(Address address, bool listens)
    : address_(std::move(address)), listens_(listens), channel_("revisit_" + address_.map) {
  if (!listens_) return;
  try {
    connect();
  } catch (const pqxx::pqxx_exception& error) {
    std::string message = without_password(error.base().what());
    throw Error(name(), ": no connection: ", message, "; ", remedy_of(message));
  }
}

Server::~Server() = default;

pqxx::connection& Server::connected() {
  if (connection_ == nullptr) try {
      connect();
    } catch (const pqxx::sql_error&) {
      throw;
    } catch (const pqxx::failure& error) {  // of any kind: the server went down meanwhile
      throw pqxx::broken_connection(error.what());
    }
  return *connection_;
}

void Server::connect() {
  auto connection = std::make_unique<pqxx::connection>(address_.url);
  // Otherwise libpqxx reconnects by itself, and notifications would be missed.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"
  connection->inhibit_reactivation(true);
#pragma GCC diagnostic pop
  connection->set_client_encoding("UTF8");
  {
    pqxx::nontransaction settings(*connection);
    settings.exec(str("SET search_path = ", address_.map));
    // Acknowledged commits are durable, whatever the server's default is.
    settings.exec(
        "SET synchronous_commit = on; SET bytea_output = hex; SET extra_float_digits = 3;"
        "SET client_min_messages = warning;"
        // The server detects a client without network within half a minute and releases its claims.
        // Claims have no time limit.
        "SET tcp_keepalives_idle = 10; SET tcp_keepalives_interval = 5; SET tcp_keepalives_count = "
        "4; SET idle_in_transaction_session_timeout = 0");
  }
  if (listens_) listener_ = std::make_unique<Listener>(*connection, channel_, updates_);
  connection_ = std::move(connection);
  updates_ = true;
}

void Server::throw_unless_lost(const pqxx::pqxx_exception& error) {
  const std::string message = without_password(error.base().what());
  if (!means_lost(error)) {
    if (is<pqxx::insufficient_resources>(error))
      throw Error(name(), ": the server has no space left: ", message);
    if (is<pqxx::insufficient_privilege>(error))
      throw Error(name(), ": the server denies access: ", message,
                  "; grant the permission to this user, or use another");
    if (is<pqxx::data_exception>(error))
      throw UsageError(name(), ": the server cannot store this: ", message);
    if (is<pqxx::undefined_column>(error) || is<pqxx::undefined_table>(error))
      throw InputError(name(), ": not a map, or another program's tables: ", message);
    throw Error(name(), ": server error: ", message);
  }
  listener_.reset();
  connection_.reset();
}

void Server::wait_after(const pqxx::pqxx_exception& lost,
                        std::optional<Clock::time_point>& lost_at) {
  const Clock::time_point now = Clock::now();
  if (!lost_at) lost_at = now;
  if (now - *lost_at >= address_.patience)
    throw Error(name(), ": the connection was lost and could not be reopened within ",
                static_cast<double>(address_.patience.count()) / 1000,
                " s: ", without_password(lost.base().what()),
                "; restart the server; acknowledged changes are kept");
  std::this_thread::sleep_for(std::min(kBetweenTries, address_.patience));
}

void Server::notify_others(pqxx::transaction_base& step) const {
  step.exec("NOTIFY " + channel_);
}

bool Server::has_notifications() {
  if (!updates_) run([](pqxx::connection& connection) { connection.get_notifs(); });
  return updates_;
}

std::string Server::without_password(std::string message) const {
  const auto replace = [&](const std::string& part, const std::string& by) {
    if (part.empty()) return;
    for (size_t at = message.find(part); at != std::string::npos;
         at = message.find(part, at + by.size()))
      message.replace(at, part.size(), by);
  };
  replace(address_.url, name());
  replace(address_.password, "***");
  while (!message.empty() && (message.back() == '\n' || message.back() == ' ')) message.pop_back();
  return message;
}

}  // namespace revisit::postgres
