#include <algorithm>

#include "driver.h"
#include "map_format.h"
#include "postgres_map.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit {
namespace {

using postgres::PostgresDriver;

/// Its transaction holds the claimed rows of `expected`; the server releases them when the
/// connection ends.
struct ServerClaim : Claim {
  ServerClaim(MapStore& to, PostgresDriver& of) : store(to), driver(of) {}
  ~ServerClaim() override {
    if (!has_ended) driver.roll_back();
  }

  /// Does not retry after a lost connection, because other processes can then claim the frames.
  std::vector<int64_t> add(std::span<const MapEntry> entries, int64_t revision) override {
    if (has_ended) throw UsageError("this claim has ended");
    for (const MapEntry& entry : entries)
      if (entry.drive != drive || std::ranges::count(frames, entry.frame) == 0)
        throw UsageError("frame ", entry.frame, " of drive '", entry.drive,
                         "' is not in this claim, of drive '", drive, "'");
    try {
      driver.execute("SAVEPOINT adding");
      std::vector<int64_t> ids = store.add(entries, revision);
      if (ids.size() < entries.size()) {
        driver.execute("ROLLBACK TO adding");  // releases the lock, but not the claim
        return ids;
      }
      for (size_t i = 0; i < ids.size(); ++i)
        driver.execute("UPDATE expected SET entry = $3 WHERE drive = $1 AND frame = $2",
                       {drive, entries[i].frame, ids[i]});
      for (const auto& [frame, error] : skipped)
        driver.execute("UPDATE expected SET error = $3 WHERE drive = $1 AND frame = $2",
                       {drive, frame, error});
      driver.execute("COMMIT");
      has_ended = true;
      driver.hold = false;
      return ids;
    } catch (const postgres::ServerError& error) {
      has_ended = true;
      driver.roll_back();
      driver.throw_unless_lost(error);
      throw ClaimLost(driver.name(), ": the connection was lost with ", frames.size(),
                      " claimed scans of drive '", drive, "'; they can be claimed again");
    }
  }

  MapStore& store;
  PostgresDriver& driver;
  bool has_ended = false;
};

class ServerWork : public WorkQueue {
 public:
  explicit ServerWork(std::unique_ptr<PostgresDriver> driver)
      : driver_(*driver), map_(std::move(driver), MapAccess::kWrite) {}

  void enqueue(const std::string& drive, std::span<const int64_t> frames) override {
    check_drive(drive);
    must_have_no_claim();
    const std::string wanted = str("{", joined(frames, ","), "}");
    driver_.transaction(Locking::kWrites, [&] {
      driver_.execute("SELECT 1 FROM counts FOR UPDATE");  // no entries are added meanwhile
      driver_.execute(
          "INSERT INTO expected (drive, frame, entry) SELECT $1, wanted, min(entry.id) FROM "
          "unnest($2::bigint[]) AS wanted LEFT JOIN entry ON entry.drive = $1 AND entry.frame = "
          "wanted GROUP BY wanted ON CONFLICT DO NOTHING",
          {drive, wanted});
    });
  }

  std::unique_ptr<Claim> claim(const std::string& drive, int64_t most) override {
    check_drive(drive);
    if (most < 1) throw UsageError("a claim of ", most, " scans: expected at least 1");
    must_have_no_claim();
    std::vector<int64_t> frames;
    driver_.transaction(Locking::kWrites, [&] {
      frames.clear();
      driver_.execute(
          "SELECT frame FROM expected WHERE drive = $1 AND entry IS NULL AND error IS NULL ORDER "
          "BY frame LIMIT $2 FOR UPDATE SKIP LOCKED",
          {drive, most}, [&](const SqlRow& row) { frames.push_back(row.integer(0)); });
      driver_.hold = true;  // until the claim ends
    });
    auto claim = std::make_unique<ServerClaim>(map_, driver_);
    claim->drive = drive;
    claim->frames = frames;
    if (frames.empty()) claim.reset();
    return claim;
  }

  int64_t pending(const std::string& drive) override {
    must_have_no_claim();
    return driver_.run(Locking::kReads, [&] {
      return driver_
          .integer(
              "SELECT count(*) FROM expected WHERE drive = $1 AND entry IS NULL AND error IS NULL",
              {drive})
          .value_or(0);
    });
  }

 private:
  void must_have_no_claim() const {
    if (driver_.hold) throw UsageError("the previous claim has not ended");
  }

  PostgresDriver& driver_;
  MapStore map_;
};

}  // namespace

std::unique_ptr<WorkQueue> open_postgres_work(const std::string& where) {
  return std::make_unique<ServerWork>(
      std::make_unique<PostgresDriver>(postgres::parse_address(where), false));
}

}  // namespace revisit
