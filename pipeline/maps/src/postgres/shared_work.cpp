#include "postgres_map.h"
#include "revisit/base/error.h"
#include "server.h"
#include "tables.h"

namespace revisit {
namespace {

using namespace postgres;

std::unique_ptr<pqxx::work> work_on(pqxx::connection& connection) {
  try {
    return std::make_unique<pqxx::work>(connection);
  } catch (const pqxx::usage_error&) {
    throw UsageError("the previous claim has not ended");
  }
}

/// Its transaction holds the claimed rows of `expected`; the server releases them when the
/// connection ends.
struct ServerClaim : Claim {
  explicit ServerClaim(Server& of) : server(of) {}

  /// Does not retry after a lost connection, because other processes can then claim the frames.
  std::vector<int64_t> add(std::span<const StoredPlace> places, int64_t revision) override {
    if (step == nullptr) throw UsageError("this claim has ended");
    check_places_of(*this, places);
    std::vector<int64_t> ids;
    try {
      pqxx::subtransaction adding(*step);  // its rollback releases the lock, but not the claim
      const int64_t there = lock_places(adding, server.name());
      const MapHead head = read_head(adding, server.name());
      if (revision != head.revision && !places.empty()) return ids;
      const int64_t first = insert_places(adding, {places, head.format}, there, head);
      const auto set = [&](int64_t frame, int64_t place, const std::string& why_not) {
        adding.exec_params(
            "UPDATE expected SET place = $3, why_not = nullif($4, '') WHERE drive = $1 AND frame "
            "= $2",
            drive, frame, place, why_not);
      };
      for (const StoredPlace& place : places) {
        ids.push_back(first + static_cast<int64_t>(ids.size()));
        set(place.frame, ids.back(), "");
      }
      for (const auto& [frame, why_not] : skipped) set(frame, 0, why_not);
      server.notify_others(adding);
      adding.commit();
      step->commit();
      step.reset();
    } catch (const pqxx::pqxx_exception& error) {
      step.reset();
      server.throw_unless_lost(error);
      throw ClaimLost(str(server.name(), ": the connection was lost with ", frames.size(),
                          " claimed scans of drive '", drive, "'; they can be claimed again"));
    }
    return ids;
  }

  Server& server;
  std::unique_ptr<pqxx::work> step;
};

class ServerWork : public WorkQueue {
 public:
  explicit ServerWork(const std::string& where) : server_(parse_address(where), false) {}

  void enqueue(const std::string& drive, std::span<const int64_t> frames) override {
    check_drive(drive);
    std::string numbers;
    for (const int64_t frame : frames) numbers += str(numbers.empty() ? "" : ",", frame);
    server_.run([&](pqxx::connection& connection) {
      const auto step = work_on(connection);
      lock_places(*step, server_.name());
      step->exec(kTableOfExpected);
      step->exec_params(
          "INSERT INTO expected (drive, frame, place) SELECT $1, wanted, min(place.id) FROM "
          "unnest($2::bigint[]) AS wanted LEFT JOIN place ON place.drive = $1 AND place.frame = "
          "wanted GROUP BY wanted ON CONFLICT DO NOTHING",
          drive, "{" + numbers + "}");
      step->commit();
    });
  }

  std::unique_ptr<Claim> claim(const std::string& drive, int64_t most) override {
    check_drive(drive);
    if (most < 1) throw UsageError("a claim of ", most, " scans: expected at least 1");
    return server_.run([&](pqxx::connection& connection) -> std::unique_ptr<Claim> {
      auto claim = std::make_unique<ServerClaim>(server_);
      claim->drive = drive;
      claim->step = work_on(connection);
      const pqxx::result rows = claim->step->exec_params(
          "SELECT frame FROM expected WHERE drive = $1 AND place IS NULL ORDER BY frame LIMIT $2 "
          "FOR UPDATE SKIP LOCKED",
          drive, most);
      for (const pqxx::row& row : rows) claim->frames.push_back(row[0].as<int64_t>());
      if (claim->frames.empty()) return nullptr;
      return claim;
    });
  }

  int64_t pending(const std::string& drive) override {
    return server_.run([&](pqxx::connection& connection) {
      const auto step = work_on(connection);
      return step
          ->exec_params("SELECT count(*) FROM expected WHERE drive = $1 AND place IS NULL",
                        drive)[0][0]
          .as<int64_t>();
    });
  }

 private:
  Server server_;
};

}  // namespace

std::unique_ptr<WorkQueue> open_postgres_work(const std::string& where) {
  return std::make_unique<ServerWork>(where);
}

}  // namespace revisit
