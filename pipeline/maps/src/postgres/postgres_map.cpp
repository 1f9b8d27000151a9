#include "postgres_map.h"

#include <algorithm>
#include <mutex>
#include <random>
#include <set>

#include "damaged_places.h"
#include "identity.h"
#include "revisit/base/error.h"
#include "server.h"
#include "tables.h"

namespace revisit::pipeline {
namespace {

using Moment = pqxx::transaction<pqxx::repeatable_read, pqxx::read_only>;
using namespace postgres;

/// The transaction holds the claimed rows of `expected`: the server lets go of them when the
/// connection ends.
struct ServerClaim : Claim {
  explicit ServerClaim(std::shared_ptr<std::recursive_mutex> mutex)
      : of_connection(std::move(mutex)) {}
  ServerClaim(const ServerClaim&) = delete;
  ServerClaim& operator=(const ServerClaim&) = delete;
  ~ServerClaim() override {
    const std::lock_guard lock(*of_connection);
    step.reset();
  }
  std::unique_ptr<pqxx::work> step;                     // null once it has ended
  std::shared_ptr<std::recursive_mutex> of_connection;  // which the next claim() may be using
};

/// A map in a schema of a PostgreSQL database.
class PostgresMap : public MapStore {
 public:
  PostgresMap(std::unique_ptr<Server> server, MapAccess access, MapHead head)
      : server_(std::move(server)), access_(access), head_(std::move(head)) {}

  const MapIdentity& identity() const override { return head_.identity; }
  NumberFormat number_format() const override { return head_.format; }

  int64_t size() const override {
    return server_->run([&](pqxx::connection& connection) {
      Moment moment(connection);
      const int64_t there = read_places(moment, server_->name(), "");
      return std::max<int64_t>(0, there - count_removed(moment, there));
    });
  }

  std::optional<std::string> value(const std::string& name) const override {
    return server_->run([&](pqxx::connection& connection) -> std::optional<std::string> {
      Moment moment(connection);
      const pqxx::result rows =
          moment.exec_params("SELECT bytes, checksum FROM value WHERE name = $1", name);
      if (rows.empty()) return std::nullopt;
      std::string bytes = bytes_in(rows[0][0]);
      if (value_checksum(name, bytes) != rows[0][1].as<int64_t>())
        throw InputError(
            str(server_->name(), ": the value '", name, "' is damaged: its checksum is wrong"));
      return bytes;
    });
  }

  void set_value(const std::string& name, const std::string& bytes) override {
    must_be_writer();
    server_->run([&](pqxx::connection& connection) {
      pqxx::work step(connection);
      lock_places(step, server_->name());
      put_value(step, name, bytes);
      server_->tell_others(step);
      step.commit();
    });
  }

  std::vector<int64_t> add(std::span<const StoredPlace> places, std::optional<int64_t> revision,
                           Claim* claim) override {
    must_be_writer();
    const Places all(places, head_.format, random_);
    if (claim != nullptr) return add_of(*claim, all, revision);
    if (places.empty()) return {};
    int64_t first = 0;  // the first id of the try before this one
    return server_->run([&](pqxx::connection& connection) {
      std::vector<int64_t> ids;
      pqxx::work step(connection);
      const int64_t there = lock_places(step, server_->name());
      // A connection that is lost in a commit leaves open what became of it: the place says it.
      const bool was_added =
          first > 0 &&
          !step.exec_params("SELECT 1 FROM place WHERE id = $1 AND call = $2", first, all.call)
               .empty();
      if (!was_added) {
        const MapHead head = read_head(step, server_->name());
        if (revision && *revision != head.revision) return ids;
        first = insert(step, all, there, head);
        step.commit();
      }
      for (size_t i = 0; i < places.size(); ++i) ids.push_back(first + static_cast<int64_t>(i));
      return ids;
    });
  }

  void expect(const std::string& drive, std::span<const int64_t> frames) override {
    must_be_writer();
    check_drive(drive);
    std::string numbers;
    for (const int64_t frame : frames) numbers += str(numbers.empty() ? "" : ",", frame);
    server_->run([&](pqxx::connection& connection) {
      pqxx::work step(connection);
      lock_places(step, server_->name());
      step.exec(kTableOfExpected);
      step.exec_params(
          "INSERT INTO expected (drive, frame, place) SELECT $1, wanted, min(place.id) FROM "
          "unnest($2::bigint[]) AS wanted LEFT JOIN place ON place.drive = $1 AND place.frame = "
          "wanted GROUP BY wanted ON CONFLICT DO NOTHING",
          drive, "{" + numbers + "}");
      step.commit();
    });
  }

  std::unique_ptr<Claim> claim(const std::string& drive, int64_t most) override {
    must_be_writer();
    check_drive(drive);
    if (most < 1) throw UsageError(str("a claim of ", most, " scans: expected at least 1"));
    const std::lock_guard lock(*of_claims_);
    if (claims_ == nullptr) claims_ = std::make_unique<Server>(server_->address(), false);
    return claims_->run([&](pqxx::connection& connection) -> std::unique_ptr<Claim> {
      auto claim = std::make_unique<ServerClaim>(of_claims_);
      claim->drive = drive;
      try {
        claim->step = std::make_unique<pqxx::work>(connection);
      } catch (const pqxx::usage_error&) {
        throw UsageError("the previous claim has not ended");
      }
      if (!has_table(*claim->step, server_->map(), "expected")) return nullptr;
      const pqxx::result rows = claim->step->exec_params(
          "SELECT frame FROM expected WHERE drive = $1 AND place IS NULL ORDER BY frame LIMIT $2 "
          "FOR UPDATE SKIP LOCKED",
          drive, most);
      for (const pqxx::row& row : rows) claim->frames.push_back(row[0].as<int64_t>());
      if (claim->frames.empty()) return nullptr;
      return claim;
    });
  }

  int64_t expected(const std::string& drive) const override {
    return server_->run([&](pqxx::connection& connection) {
      Moment moment(connection);
      if (!has_table(moment, server_->map(), "expected")) return int64_t{0};
      return moment
          .exec_params("SELECT count(*) FROM expected WHERE drive = $1 AND place IS NULL",
                       drive)[0][0]
          .as<int64_t>();
    });
  }

  MapPosition read(int64_t after, const Take& take, const Damaged& damaged) const override {
    const auto tell_once = [&](const std::string& what) {
      if (told_.insert(what).second) damaged(what);
    };
    MapPosition at{.last = std::max<int64_t>(after, 0), .revision = -1};
    DamagedPlaces places(server_->name(), damaged);
    server_->forget_news();  // before the moment: what comes later is told again
    server_->run([&](pqxx::connection& connection) {
      connection.get_notifs();
      server_->forget_news();
      Moment moment(connection);
      const MapHead head = read_head(moment, server_->name());
      std::string damage;
      const int64_t there = read_places(moment, server_->name(), "", &damage);
      if (!damage.empty())
        tell_once(str(server_->name(), ": the number of places is damaged: ", damage, "; ", there,
                      " is the last that was found"));
      // The connection was lost on the way, and the moment is another: the next read() goes on.
      if (at.revision >= 0 && at.revision != head.revision) return server_->has_more_news();
      // Of the first moment: what was removed after it may have been handed over.
      if (at.revision < 0) {
        at.removed = last_removal(moment);
        const std::string what = after <= 0 ? damage_of_removed(moment, there) : "";
        if (!what.empty())
          tell_once(str(server_->name(), ": the list of removed places is damaged: ", what));
      }
      at.revision = head.revision;
      select_places(
          moment, head, there, at.last,
          [&](StoredPlace&& place, int64_t) {
            places.flush();  // a caller that throws has heard of it
            take(std::move(place));
          },
          [&](int64_t first, int64_t last, const std::string& reason) {
            places.add(first, last, reason);
          });
    });
    places.flush();
    return at;
  }

  bool has_news(std::chrono::milliseconds wait) override { return server_->was_told(wait); }

  bool replace_descriptors(
      const std::function<std::vector<float>(const StoredPlace&)>& descriptor_of,
      const std::map<std::string, std::string>& values, int64_t revision) override {
    must_be_writer();
    return server_->run([&](pqxx::connection& connection) {
      pqxx::work step(connection);
      const int64_t there = lock_places(step, server_->name());
      MapHead head = read_head(step, server_->name());
      if (head.revision != revision) return false;
      int64_t last = 0;
      select_places(
          step, head, there, last,
          [&](StoredPlace&& place, int64_t call) {
            place.descriptor = descriptor_of(place);
            place.feature.clear();
            write_place(step, kReplacePlaceAt, place.id, place,
                        place_row(place, head.format, place.id), revision + 1, call);
          },
          [](int64_t, int64_t, const std::string&) {});
      ++head.revision;
      write_head(step, head);
      for (const auto& [name, bytes] : values) put_value(step, name, bytes);
      server_->tell_others(step);
      step.commit();
      return true;
    });
  }

  int64_t remove(std::span<const int64_t> ids) override {
    must_be_writer();
    std::optional<int64_t> before;  // how many were removed before the first try
    std::set<int64_t> to_remove;
    const auto n = [&] { return static_cast<int64_t>(to_remove.size()); };
    return server_->run([&](pqxx::connection& connection) {
      pqxx::work step(connection);
      const int64_t there = lock_places(step, server_->name());
      // A connection that is lost in a commit leaves open what became of it: the list says it.
      const bool was_done =
          before &&
          std::ranges::equal(
              to_remove,
              read_removed(step, str("id > ", *before, " AND id <= ", *before + n())).ids);
      if (!was_done) {
        to_remove = ids_to_remove(ids, there);
        for (const int64_t id : read_removed(step, "true").ids) to_remove.erase(id);
        if (to_remove.empty()) return int64_t{0};
        before = last_removal(step);
        remove_places(step, to_remove);
        server_->tell_others(step);
        step.commit();
      }
      return n();
    });
  }

  std::vector<int64_t> removed(int64_t after) const override {
    return server_->run([&](pqxx::connection& connection) {
      Moment moment(connection);
      return read_removed(moment, str("id > ", after)).ids;
    });
  }

  std::vector<std::string> check() const {
    std::vector<std::string> wrong;
    const auto add_to = [&](const std::string& what) { wrong.push_back(what); };
    read(
        0, [](StoredPlace&&) {}, add_to);
    const pqxx::result values = server_->run([&](pqxx::connection& connection) {
      Moment moment(connection);
      return moment.exec("SELECT name, bytes, checksum FROM value ORDER BY name");
    });
    for (const pqxx::row& row : values)
      if (value_checksum(row[0].as<std::string>(), bytes_in(row[1])) != row[2].as<int64_t>())
        add_to(str(server_->name(), ": the value '", row[0].as<std::string>(),
                   "' is damaged: its checksum is wrong"));
    return wrong;
  }

 private:
  void must_be_writer() const {
    if (access_ == MapAccess::kRead)
      throw UsageError(str(server_->name(), ": this map was opened for reading (MapAccess)"));
  }

  /// Places as they are added. `call` tells them from those of other calls.
  struct Places {
    std::span<const StoredPlace> places;
    std::vector<PlaceRow> rows;
    int64_t call;
    Places(std::span<const StoredPlace> of, NumberFormat format, std::random_device& random)
        : places(of), call(static_cast<int64_t>((uint64_t{random()} << 32) | random())) {
      for (const StoredPlace& place : places)
        rows.push_back(place_row(place, format, rows.size() + 1));
    }
  };

  /// The id of the first; the others follow.
  int64_t insert(pqxx::transaction_base& step, const Places& all, int64_t there,
                 const MapHead& head) const {
    for (size_t i = 0; i < all.rows.size(); ++i)
      write_place(step, kInsertPlaceAt, there + 1 + static_cast<int64_t>(i), all.places[i],
                  all.rows[i], head.revision, all.call);
    write_places(step, there + static_cast<int64_t>(all.rows.size()));
    server_->tell_others(step);
    return there + 1;
  }

  /// What is claimed is not tried again when the connection is lost: then others have it.
  std::vector<int64_t> add_of(Claim& claim, const Places& all, std::optional<int64_t> revision) {
    check_places_of(claim, all.places);
    auto* own = dynamic_cast<ServerClaim*>(&claim);
    if (own == nullptr || own->step == nullptr || own->of_connection != of_claims_)
      throw UsageError("this claim has ended, or is another map's");
    const std::lock_guard lock(*of_claims_);
    std::vector<int64_t> ids;
    pqxx::work& step = *own->step;
    try {
      pqxx::subtransaction adding(step);  // taken back, it lets go of the lock, not of the claim
      const int64_t there = lock_places(adding, server_->name());
      const MapHead head = read_head(adding, server_->name());
      if (revision && *revision != head.revision && !all.rows.empty()) return ids;
      const int64_t first = insert(adding, all, there, head);
      const auto set = [&](int64_t frame, int64_t place, const std::string& why_not) {
        adding.exec_params(
            "UPDATE expected SET place = $3, why_not = nullif($4, '') WHERE drive = $1 AND frame "
            "= $2",
            claim.drive, frame, place, why_not);
      };
      for (const StoredPlace& place : all.places) {
        ids.push_back(first + static_cast<int64_t>(ids.size()));
        set(place.frame, ids.back(), "");
      }
      for (const auto& [frame, why_not] : claim.left_out) set(frame, 0, why_not);
      adding.commit();
      step.commit();
      own->step.reset();
    } catch (const pqxx::pqxx_exception& error) {
      own->step.reset();
      claims_->throw_unless_lost(error);
      throw ClaimLost(str(server_->name(), ": the connection was lost with ", claim.frames.size(),
                          " claimed scans of drive '", claim.drive,
                          "'; they can be claimed again"));
    }
    return ids;
  }

  static void put_value(pqxx::transaction_base& step, const std::string& name,
                        const std::string& bytes) {
    step.exec_params(
        "INSERT INTO value VALUES ($1, $2, $3) ON CONFLICT (name) DO UPDATE SET bytes = "
        "EXCLUDED.bytes, checksum = EXCLUDED.checksum",
        name, bytes_of(bytes), value_checksum(name, bytes));
  }

  std::unique_ptr<Server> server_, claims_;  // of the second, one transaction a claim
  std::shared_ptr<std::recursive_mutex> of_claims_ = std::make_shared<std::recursive_mutex>();
  MapAccess access_;
  MapHead head_;  // as it was when the map was opened
  std::random_device random_;
  mutable std::set<std::string> told_;
};

/// `identity`: the map is made with it when there is none; with kNew there must be none.
std::unique_ptr<PostgresMap> open_map_at(const std::string& where, MapAccess access,
                                         const MapIdentity* identity, NumberFormat format) {
  auto server = std::make_unique<Server>(postgres::parse_address(where));
  bool made = false;  // perhaps: by the try before this one, whose connection was lost
  const MapHead head = server->run([&](pqxx::connection& connection) {
    pqxx::work step(connection);
    const auto is_there = [&] { return has_table(step, server->map(), "map"); };
    if (!is_there()) {
      if (identity == nullptr || access == MapAccess::kRead)
        throw InputError(
            str(server->name(), ": there is no map '", server->map(), "' in this database"));
      step.exec(str("SELECT pg_advisory_xact_lock(", kApplicationId, ")"));  // one makes it
      if (!is_there()) {
        step.exec(str("CREATE SCHEMA IF NOT EXISTS ", server->map()));
        step.exec(kTables);
        step.exec(kTableOfRemoved);
        write_head(step, {.identity = *identity, .format = format});
        write_places(step, 0);
        made = true;
      }
    }
    if (access == MapAccess::kNew && !made)
      throw InputError(str(server->name(), ": already exists"));
    // Without this right the server would say that there are no tables.
    if (!step.exec_params("SELECT has_schema_privilege($1, 'USAGE')", server->map())[0][0]
             .as<bool>())
      throw Error(str(server->name(), ": the server does not allow it: no right to use the schema ",
                      server->map(), "; give this user the right, or use another"));
    MapHead found = read_head(step, server->name());
    step.commit();
    return found;
  });
  return std::make_unique<PostgresMap>(std::move(server), access, head);
}

}  // namespace

std::unique_ptr<MapStore> open_postgres_map(const std::string& where, MapAccess access,
                                            const MapIdentity* identity, NumberFormat format) {
  auto map = open_map_at(where, access, identity, format);
  if (identity != nullptr) must_match(shown_name(where), map->identity(), *identity);
  return map;
}

std::vector<std::string> check_postgres_map(const std::string& where) {
  const auto map = open_map_at(where, MapAccess::kRead, nullptr, NumberFormat::kFloat32);
  return map->check();
}

}  // namespace revisit::pipeline
