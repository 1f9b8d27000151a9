#include "driver.h"

#include <random>
#include <thread>

#include "map_tables.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit {
namespace {

constexpr std::chrono::milliseconds kBetweenTries{100};

const SqlDialect kPostgres{.id = "BIGINT PRIMARY KEY",
                           .integer = "BIGINT",
                           .real = "FLOAT8",
                           .blob = "BYTEA",
                           .for_update = " FOR UPDATE",
                           .integrity_check = nullptr};

/// Table `expected`: frames of WorkQueue::enqueue(), pending without entry and error. Table
/// `writer`: number of transactions that a process has committed.
constexpr const char* kTablesOfServer =
    "ALTER TABLE map ADD version INTEGER NOT NULL DEFAULT 1;"
    "CREATE TABLE expected (drive TEXT NOT NULL, frame BIGINT NOT NULL, entry BIGINT REFERENCES "
    "entry (id) ON DELETE CASCADE, error TEXT, PRIMARY KEY (drive, frame));"
    "CREATE INDEX ON expected (entry);"
    "CREATE TABLE writer (id BIGINT PRIMARY KEY, transactions BIGINT NOT NULL)";
static_assert(kMapVersion == 1);

enum Type : pqxx::oid { kBytes = 17, kInt8 = 20, kInt2 = 21, kInt4 = 23, kFloat8 = 701 };

/// As the server writes it; null for NULL.
std::optional<std::string> text_of(const SqlValue& value) {
  if (const auto* integer = std::get_if<int64_t>(&value)) return std::to_string(*integer);
  if (const auto* real = std::get_if<double>(&value)) return exact(*real);  // in every locale
  if (const auto* text = std::get_if<std::string_view>(&value)) return std::string(*text);
  const auto* blob = std::get_if<Blob>(&value);
  if (blob == nullptr) return std::nullopt;
  std::string hex = "\\x";
  hex.reserve(2 + 2 * blob->bytes.size());
  for (const char c : blob->bytes) {
    constexpr const char* kDigits = "0123456789abcdef";
    const auto byte = static_cast<unsigned char>(c);
    hex += {kDigits[byte >> 4], kDigits[byte & 15]};
  }
  return hex;
}

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

namespace postgres {

class PostgresDriver::Listener : public pqxx::notification_receiver {
 public:
  Listener(pqxx::connection& connection, const std::string& channel, bool& updates)
      : notification_receiver(connection, channel), updates_(updates) {}
  void operator()(const std::string&, int process) override {
    if (process != conn().backendpid()) updates_ = true;
  }

 private:
  bool& updates_;
};

PostgresDriver::PostgresDriver(Address address, bool listens)
    : SqlDriver(address.name, kPostgres),
      address_(std::move(address)),
      listens_(listens),
      channel_("revisit_" + address_.map) {
  std::random_device random;
  id_ = static_cast<int64_t>((uint64_t{random()} << 32) | random());
  if (!listens_) return;
  try {
    connect();
  } catch (const pqxx::pqxx_exception& error) {
    const std::string message = without_password(error.base().what());
    throw Error(name(), ": no connection: ", message, "; ", remedy_of(message));
  }
}

PostgresDriver::~PostgresDriver() = default;

void PostgresDriver::connect() {
  auto connection = std::make_unique<pqxx::connection>(address_.url);
  // Otherwise libpqxx reconnects by itself, and notifications would be missed.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"
  connection->inhibit_reactivation(true);
#pragma GCC diagnostic pop
  connection->set_client_encoding("UTF8");
  {
    pqxx::nontransaction settings(*connection);
    settings.exec(str("SET search_path = ", connection->quote_name(address_.map)));
    // Acknowledged commits are durable, whatever the server's default is.
    settings.exec(
        "SET synchronous_commit = on; SET bytea_output = hex; SET extra_float_digits = 3;"
        "SET client_min_messages = warning;"
        // The server detects a client without network within half a minute and releases its claims.
        // Claims have no time limit.
        "SET tcp_keepalives_idle = 10; SET tcp_keepalives_interval = 5; SET tcp_keepalives_count = "
        "4; SET idle_in_transaction_session_timeout = 0");
  }
  if (listens_) listener_ = std::make_unique<Listener>(*connection, channel_, updates);
  connection_ = std::move(connection);
  updates = true;  // changes before the connection are unknown
}

void PostgresDriver::disconnect() {
  listener_.reset();
  connection_.reset();
}

void PostgresDriver::execute(const std::string& sql, const std::vector<SqlValue>& values,
                             const Take& take) {
  std::vector<std::optional<std::string>> texts;
  for (const SqlValue& value : values) texts.push_back(text_of(value));
  std::vector<const char*> parameters;
  for (const auto& text : texts) parameters.push_back(text ? text->c_str() : nullptr);
  pqxx::result rows;
  {
    pqxx::nontransaction step(*connection_);
    rows = values.empty() ? step.exec(sql)
                          : step.exec_params(sql, pqxx::prepare::make_dynamic_params(parameters));
  }
  if (!take) return;
  for (const pqxx::row& row : rows) {
    SqlRow converted{name(), {}};
    std::vector<std::string> bytes;
    bytes.reserve(row.size());
    for (const pqxx::field& field : row) {
      auto& cell = converted.cells.emplace_back(nullptr);
      if (field.is_null()) continue;
      const pqxx::oid type = field.type();
      if (type == kInt8 || type == kInt4 || type == kInt2)
        cell = field.as<int64_t>();
      else if (type == kFloat8)
        cell = field.as<double>();
      else if (type == kBytes)
        cell = std::string_view(bytes.emplace_back(pqxx::binarystring(field).str()));
      else
        cell = std::string_view(field.c_str(), field.size());
    }
    take(converted);
  }
}

void PostgresDriver::transaction(Locking locking, const std::function<void()>& work) {
  if (hold) return work();
  if (locking == Locking::kWrites) ++transactions_;
  bool again = false;
  retry([&] { run_transaction(locking, work, std::exchange(again, true)); });
}

void PostgresDriver::run_transaction(Locking locking, const std::function<void()>& work,
                                     bool again) {
  try {
    if (locking == Locking::kReads) {
      execute("BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY");
      work();
    } else {
      execute("BEGIN");
      if (!again || !was_committed()) {
        work();
        execute(
            "INSERT INTO writer VALUES ($1, $2) ON CONFLICT (id) DO UPDATE SET transactions = "
            "excluded.transactions",
            {id_, transactions_});
      }
    }
    execute("COMMIT");
  } catch (...) {
    roll_back();
    throw;
  }
}

/// After a lost commit the outcome is unknown. Waits for a commit that has not ended.
bool PostgresDriver::was_committed() {
  // Not to_regclass(), which caches within a transaction that a schema is missing.
  if (!integer("SELECT 1 FROM pg_tables WHERE schemaname = $1 AND tablename = 'writer'", {map()}))
    return false;
  return integer(
             "INSERT INTO writer VALUES ($1, 0) ON CONFLICT (id) DO UPDATE SET transactions = "
             "writer.transactions RETURNING transactions",
             {id_}) == transactions_;
}

void PostgresDriver::roll_back() {
  hold = false;
  if (connection_ != nullptr) try {
      execute("ROLLBACK");
    } catch (const pqxx::pqxx_exception&) {
      disconnect();
    }
}

bool PostgresDriver::has_updates() {
  if (!updates) retry([&] { connection_->get_notifs(); });
  return updates;
}

void PostgresDriver::retry(const std::function<void()>& work) {
  for (std::optional<Clock::time_point> lost_at;;) {
    try {
      if (connection_ == nullptr) try {
          connect();
        } catch (const pqxx::sql_error&) {
          throw;
        } catch (const pqxx::failure& error) {  // of any kind: the server went down meanwhile
          throw pqxx::broken_connection(error.what());
        }
      return work();
    } catch (const pqxx::pqxx_exception& error) {
      throw_unless_lost(error);
      wait_after(error, lost_at);
    }
  }
}

void PostgresDriver::throw_unless_lost(const pqxx::pqxx_exception& error) {
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
  disconnect();
}

void PostgresDriver::wait_after(const pqxx::pqxx_exception& lost,
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

std::string PostgresDriver::without_password(std::string message) const {
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

}  // namespace postgres

std::unique_ptr<SqlDriver> open_postgres_map(const std::string& where, MapAccess access,
                                             const MapFingerprint* fingerprint,
                                             DescriptorType format) {
  auto driver = std::make_unique<postgres::PostgresDriver>(postgres::parse_address(where));
  const auto count = [&](const char* sql) {
    return driver->integer(sql, {driver->map()}).value_or(0);
  };
  bool exists = false;
  const auto look = [&] {
    exists =
        count("SELECT count(*) FROM pg_tables WHERE schemaname = $1 AND tablename = 'map'") > 0;
    // Without this privilege the server would report missing tables.
    if (exists && count("SELECT has_schema_privilege($1, 'USAGE')::int") == 0)
      throw Error(driver->name(), ": the server denies access: no right to use the schema ",
                  driver->map(), "; grant it to this user, or use another");
  };
  driver->transaction(Locking::kReads, look);
  if (!exists && (fingerprint == nullptr || access == MapAccess::kRead))
    throw InputError(driver->name(), ": there is no map '", driver->map(), "' in this database");
  if (!exists)
    driver->transaction(Locking::kWrites, [&] {
      driver->execute(str("SELECT pg_advisory_xact_lock(", kApplicationId, ")"));
      look();  // another process may have created it meanwhile
      if (exists) return;
      if (count("SELECT count(*) FROM pg_class WHERE relnamespace = "
                "to_regnamespace(quote_ident($1))") > 0)
        throw InputError(driver->name(), ": the schema ", driver->map(),
                         " has tables, but not a map; use another map=NAME");
      driver->execute(str("CREATE SCHEMA IF NOT EXISTS \"", driver->map(), "\""));
      create_tables(*driver, {.fingerprint = *fingerprint, .format = format});
      driver->execute(kTablesOfServer);
    });
  if (access == MapAccess::kNew && exists) throw InputError(driver->name(), ": already exists");
  driver->transaction(Locking::kReads, [&] {
    if (const auto version = driver->integer("SELECT version FROM map WHERE id = 1");
        version && *version != kMapVersion)
      throw InputError(driver->name(), ": map version ", *version, " (expected ", kMapVersion,
                       "); build the map again, or use another revisit");
  });
  return driver;
}

}  // namespace revisit
