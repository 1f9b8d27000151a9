#include <poll.h>
#include <postgresql/libpq-fe.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <random>
#include <stdexcept>
#include <thread>

#include "map_format.h"
#include "postgres_map.h"
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
                           .claim =
                               "SELECT frame FROM unnest($1::bigint[]) AS frame WHERE "
                               "pg_try_advisory_lock(hashtextextended(current_schema() || "
                               "'/' || $2, frame)) LIMIT $3",
                           .end_claims = "SELECT pg_advisory_unlock_all()",
                           .integrity_check = nullptr,
                           .give_back_space = nullptr};

/// Column of a result in the server's binary format. Texts and blobs are their bytes.
SqlValue value_of(const PGresult* result, int row, int column) {
  enum Type : Oid { kInt8 = 20, kInt2 = 21, kInt4 = 23, kFloat8 = 701 };
  if (PQgetisnull(result, row, column) != 0) return nullptr;
  const std::string_view bytes(PQgetvalue(result, row, column),
                               static_cast<size_t>(PQgetlength(result, row, column)));
  const Oid type = PQftype(result, column);
  const bool is_number = type == kInt8 || type == kInt4 || type == kInt2 || type == kFloat8;
  if (!is_number || bytes.empty() || bytes.size() > sizeof(uint64_t)) return bytes;
  uint64_t bits = 0;  // big-endian
  for (const char byte : bytes) bits = bits << 8 | static_cast<unsigned char>(byte);
  if (type == kFloat8) return std::bit_cast<double>(bits);
  const size_t unused = 64 - 8 * bytes.size();
  return static_cast<int64_t>(bits << unused) >> unused;
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

struct ServerError : std::runtime_error {
  using std::runtime_error::runtime_error;
  bool is_lost = true;  // the connection
  std::string state;    // postgresql.org/docs/current/errcodes-appendix.html; "": of the connection
};

/// A connection to a server that is reopened when it is lost. Messages begin with the address
/// without its password and never contain the password.
class PostgresDriver : public SqlDriver {
 public:
  /// Connects now, without retrying.
  explicit PostgresDriver(postgres::Address address);

  /// Outside of transaction(), throws ServerError.
  void execute(const std::string& sql, const std::vector<SqlValue>& values = {},
               const Take& take = {}) override;
  void transaction(Locking locking, const std::function<void()>& work) override;
  void notify() override { execute("NOTIFY " + channel_); }
  bool has_updates() override;

  const std::string& map() const { return address_.map; }

 private:
  using Result = std::unique_ptr<PGresult, decltype(&PQclear)>;

  void connect();
  Result checked(PGresult* result) const;
  Result answer() const;
  void run_transaction(Locking locking, const std::function<void()>& work, bool again);
  bool was_committed();
  /// Calls `work`, again if the connection is lost. Throws Error if the server stays unavailable or
  /// rejects the work, and UsageError for values it cannot store.
  void retry(const std::function<void()>& work);
  /// Throws the corresponding error, or returns if the connection is lost.
  void throw_unless_lost(const ServerError& error);
  std::string without_password(std::string message) const;

  postgres::Address address_;
  std::string channel_;
  int64_t id_, transactions_ = 0;  // row of table `writer`: number of transactions committed
  std::unique_ptr<PGconn, decltype(&PQfinish)> connection_{nullptr, &PQfinish};
};

PostgresDriver::PostgresDriver(postgres::Address address)
    : SqlDriver(address.name, kPostgres),
      address_(std::move(address)),
      channel_("revisit_" + address_.map) {
  std::random_device random;
  id_ = static_cast<int64_t>((uint64_t{random()} << 32) | random());
  try {
    connect();
  } catch (const ServerError& error) {
    const std::string message = without_password(error.what());
    throw Error(name(), ": no connection: ", message, "; ", remedy_of(message));
  }
}

void PostgresDriver::connect() {
  connection_.reset(PQconnectdb(address_.url.c_str()));
  PGconn* const to = connection_.get();
  if (PQstatus(to) != CONNECTION_OK) checked(nullptr);
  PQsetNoticeProcessor(
      to, [](void*, const char*) {}, nullptr);
  // Acknowledged commits are durable, whatever the server's default is. The server detects a client
  // without network within half a minute and releases its claims. Claims have no time limit.
  PQsendQuery(to, str("SET search_path = \"", address_.map,
                      "\"; SET client_encoding = UTF8; "
                      "SET synchronous_commit = on; SET tcp_keepalives_idle = 10; "
                      "SET tcp_keepalives_interval = 5; SET tcp_keepalives_count = 4; "
                      "LISTEN ",
                      channel_)
                      .c_str());
  answer();
  ++connections;
  updates = true;  // changes before the connection are unknown
}

PostgresDriver::Result PostgresDriver::checked(PGresult* result) const {
  Result owned(result, &PQclear);
  const ExecStatusType status = PQresultStatus(result);
  if (status == PGRES_COMMAND_OK || status == PGRES_TUPLES_OK) return owned;
  ServerError error(PQerrorMessage(connection_.get()));
  if (const char* state = PQresultErrorField(result, PG_DIAG_SQLSTATE)) error.state = state;
  // Without a state the server did not answer. 57P..: it shuts down or starts; 08...: the
  // connection failed.
  error.is_lost = error.state.empty() || PQstatus(connection_.get()) != CONNECTION_OK ||
                  error.state.starts_with("57P") || error.state.starts_with("08");
  throw error;
}

/// Of the statement sent before, which may wait for other processes, but not forever.
PostgresDriver::Result PostgresDriver::answer() const {
  PGconn* const from = connection_.get();
  constexpr int kSlice = 20;  // [ms]; poll() does not see bytes that TLS has read
  const int64_t limit = std::max<int64_t>(2000, 30 * address_.patience.count());  // [ms]
  Result last(nullptr, &PQclear);
  while (true) {
    pollfd socket{PQsocket(from), POLLIN, 0};
    for (int64_t silent = 0; PQisBusy(from) != 0;) {
      silent = ::poll(&socket, 1, kSlice) == 0 ? silent + kSlice : 0;
      if (silent > limit) throw ServerError("the server does not answer");
      if (PQconsumeInput(from) == 0) checked(nullptr);
    }
    PGresult* const next = PQgetResult(from);
    if (next == nullptr) return checked(last.release());
    last.reset(next);
  }
}

void PostgresDriver::execute(const std::string& sql, const std::vector<SqlValue>& values,
                             const Take& take) {
  std::vector<std::string> texts(values.size());
  std::vector<const char*> parameters;
  std::vector<int> sizes, are_binary;
  for (size_t i = 0; i < values.size(); ++i) {
    if (const auto* integer = std::get_if<int64_t>(&values[i])) texts[i] = std::to_string(*integer);
    if (const auto* real = std::get_if<double>(&values[i])) texts[i] = exact(*real);
    if (const auto* text = std::get_if<std::string_view>(&values[i])) texts[i] = *text;
    if (const auto* blob = std::get_if<Blob>(&values[i])) texts[i] = blob->bytes;
    const bool is_null = std::holds_alternative<std::nullptr_t>(values[i]);
    parameters.push_back(is_null ? nullptr : texts[i].c_str());
    sizes.push_back(static_cast<int>(texts[i].size()));
    are_binary.push_back(std::holds_alternative<Blob>(values[i]) ? 1 : 0);
  }
  PQsendQueryParams(connection_.get(), sql.c_str(), static_cast<int>(values.size()), nullptr,
                    parameters.data(), sizes.data(), are_binary.data(), 1);
  const Result rows = answer();
  if (!take) return;
  for (int row = 0; row < PQntuples(rows.get()); ++row) {
    SqlRow converted{name(), {}};
    for (int column = 0; column < PQnfields(rows.get()); ++column)
      converted.cells.push_back(value_of(rows.get(), row, column));
    take(converted);
  }
}

void PostgresDriver::transaction(Locking locking, const std::function<void()>& work) {
  if (locking == Locking::kWrites) ++transactions_;
  bool again = false;
  retry([&] { run_transaction(locking, work, std::exchange(again, true)); });
}

void PostgresDriver::run_transaction(Locking locking, const std::function<void()>& work,
                                     bool again) {
  const bool writes = locking == Locking::kWrites;
  try {
    execute(writes ? "BEGIN" : "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY");
    if (!again || !writes || !was_committed()) {
      work();
      if (writes)
        execute(
            "INSERT INTO writer VALUES ($1, $2) ON CONFLICT (id) DO UPDATE SET transactions = "
            "excluded.transactions",
            {id_, transactions_});
    }
    execute("COMMIT");
  } catch (...) {
    if (connection_ != nullptr) try {
        execute("ROLLBACK");
      } catch (const ServerError&) {
        connection_.reset();
      }
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

bool PostgresDriver::has_updates() {
  if (!updates)
    retry([&] {
      if (PQconsumeInput(connection_.get()) == 0) checked(nullptr);
      while (PGnotify* const found = PQnotifies(connection_.get())) {
        if (found->be_pid != PQbackendPID(connection_.get())) updates = true;
        PQfreemem(found);
      }
    });
  return updates;
}

void PostgresDriver::retry(const std::function<void()>& work) {
  using Clock = std::chrono::steady_clock;
  for (std::optional<Clock::time_point> lost_at;;) {
    try {
      if (connection_ == nullptr) connect();
      return work();
    } catch (const ServerError& error) {
      throw_unless_lost(error);
      if (!lost_at) lost_at = Clock::now();
      if (Clock::now() - *lost_at >= address_.patience)
        throw Error(name(), ": the connection was lost and could not be reopened within ",
                    static_cast<double>(address_.patience.count()) / 1000,
                    " s: ", without_password(error.what()),
                    "; restart the server; acknowledged changes are kept");
      std::this_thread::sleep_for(std::min(kBetweenTries, address_.patience));
    }
  }
}

void PostgresDriver::throw_unless_lost(const ServerError& error) {
  if (error.is_lost) return connection_.reset();
  const std::string message = without_password(error.what());
  const std::string kind = error.state.substr(0, 2);
  if (kind == "53") throw Error(name(), ": the server has no space left: ", message);
  if (error.state == "42501")
    throw Error(name(), ": the server denies access: ", message,
                "; grant the permission to this user, or use another");
  if (kind == "22") throw UsageError(name(), ": the server cannot store this: ", message);
  if (error.state == "42703" || error.state == "42P01")  // an undefined column or table
    throw InputError(name(), ": not a map, or another program's tables: ", message);
  throw Error(name(), ": server error: ", message);
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

}  // namespace

std::unique_ptr<SqlDriver> open_postgres_map(const std::string& where, MapAccess access,
                                             const MapFingerprint* fingerprint,
                                             DescriptorType format) {
  auto driver = std::make_unique<PostgresDriver>(postgres::parse_address(where));
  const std::string schema = str("\"", driver->map(), "\"");
  const auto finds = [&](const char* sql) {
    return driver->integer(sql, {driver->map()}).has_value();
  };
  bool exists = false;
  const auto look = [&] {
    exists = finds("SELECT 1 FROM pg_tables WHERE schemaname = $1 AND tablename = 'map'");
    if (!exists) return;
    // With the schema's name: without the right to use it, the server would not find the table.
    const auto version = driver->integer(str("SELECT version FROM ", schema, ".map WHERE id = 1"));
    if (version && *version != kMapVersion)
      throw InputError(driver->name(), ": map version ", *version, " (expected ", kMapVersion,
                       "); build the map again, or use another revisit");
  };
  driver->transaction(Locking::kReads, look);
  if (!exists && (fingerprint == nullptr || access == MapAccess::kRead))
    throw InputError(driver->name(), ": there is no map '", driver->map(), "' in this database");
  if (!exists)
    driver->transaction(Locking::kWrites, [&] {
      driver->execute(str("SELECT pg_advisory_xact_lock(", kApplicationId, ")"));
      look();  // another process may have created it meanwhile
      if (exists) return;
      if (finds("SELECT 1 FROM pg_class WHERE relnamespace = to_regnamespace(quote_ident($1))"))
        throw InputError(driver->name(), ": the schema ", driver->map(),
                         " has tables, but not a map; use another map=NAME");
      driver->execute("CREATE SCHEMA IF NOT EXISTS " + schema);
      create_tables(*driver, {.fingerprint = *fingerprint, .format = format});
      driver->execute(str("ALTER TABLE map ADD version INTEGER NOT NULL DEFAULT ", kMapVersion));
      driver->execute("CREATE TABLE writer (id BIGINT PRIMARY KEY, transactions BIGINT NOT NULL)");
    });
  if (access == MapAccess::kNew && exists) throw InputError(driver->name(), ": already exists");
  return driver;
}

}  // namespace revisit
