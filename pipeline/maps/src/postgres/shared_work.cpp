#include <algorithm>

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

void check_entries_of(const Claim& claim, std::span<const MapEntry> entries) {
  for (const MapEntry& entry : entries)
    if (entry.drive != claim.drive || std::ranges::count(claim.frames, entry.frame) == 0)
      throw UsageError("frame ", entry.frame, " of drive '", entry.drive,
                       "' is not in this claim, of drive '", claim.drive, "'");
}

/// Its transaction holds the claimed rows of `expected`; the server releases them when the
/// connection ends.
struct ServerClaim : Claim {
  explicit ServerClaim(Server& of) : server(of) {}

  /// Does not retry after a lost connection, because other processes can then claim the frames.
  std::vector<int64_t> add(std::span<const MapEntry> entries, int64_t revision) override {
    if (step == nullptr) throw UsageError("this claim has ended");
    check_entries_of(*this, entries);
    std::vector<int64_t> ids;
    try {
      pqxx::subtransaction adding(*step);  // its rollback releases the lock, but not the claim
      const int64_t there = lock_entries(adding, server.name());
      const MapHeader header = read_header(adding, server.name());
      if (revision != header.revision && !entries.empty()) return ids;
      const int64_t first = insert_entries(adding, {entries, header.format}, there, header);
      const auto set = [&](int64_t frame, int64_t entry, const std::string& error) {
        adding.exec_params(
            "UPDATE expected SET entry = $3, error = nullif($4, '') WHERE drive = $1 AND frame "
            "= $2",
            drive, frame, entry, error);
      };
      for (const MapEntry& entry : entries) {
        ids.push_back(first + static_cast<int64_t>(ids.size()));
        set(entry.frame, ids.back(), "");
      }
      for (const auto& [frame, error] : skipped) set(frame, 0, error);
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
      lock_entries(*step, server_.name());
      step->exec_params(
          "INSERT INTO expected (drive, frame, entry) SELECT $1, wanted, min(entry.id) FROM "
          "unnest($2::bigint[]) AS wanted LEFT JOIN entry ON entry.drive = $1 AND entry.frame = "
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
          "SELECT frame FROM expected WHERE drive = $1 AND entry IS NULL ORDER BY frame LIMIT $2 "
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
          ->exec_params("SELECT count(*) FROM expected WHERE drive = $1 AND entry IS NULL",
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
