#include "postgres_map.h"

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include "coordinates.h"
#include "map_entries.h"
#include "postgres_server.h"
#include "revisit/maps/map.h"
#include "testing.h"

namespace revisit {
namespace {

using std::chrono::milliseconds;

const MapFingerprint kOfServer{{"feature", "numbers"}, {"weights", "sha256 0123"}};

class PostgresMap : public ::testing::Test {
 protected:
  void SetUp() override {
    if (const std::string why = PostgresServer::missing(); !why.empty()) GTEST_SKIP() << why;
    server_ = &PostgresServer::without_maps();
  }
  std::unique_ptr<MapStore> writer() {
    return open_map(server_->url("town"), MapAccess::kWrite, &kOfServer);
  }
  std::unique_ptr<MapStore> reader() { return open_map(server_->url("town"), MapAccess::kRead); }
  void restart() {
    server_->kill();
    server_->start();
  }
  PostgresServer* server_ = nullptr;
};

bool gets_updates(MapStore& map) {
  for (int tries = 0; tries < 20'000; ++tries) {
    if (map.has_updates()) return true;
    std::this_thread::sleep_for(milliseconds(1));
  }
  return false;
}

/// Expects ascending ids without gaps and every entry once, as it was made; returns the frames of
/// each drive.
std::map<std::string, std::set<int64_t>> frames_of(const MapStore& map) {
  const ReadMap read = read_all(map);
  EXPECT_EQ(read.problems, std::vector<std::string>());
  std::map<std::string, std::set<int64_t>> frames;
  int64_t id = read.state.removed;
  for (const MapEntry& entry : read.entries) {
    EXPECT_EQ(entry.id, ++id);
    EXPECT_TRUE(same(entry, made_entry(entry.drive, entry.frame))) << id;
    EXPECT_TRUE(frames[entry.drive].insert(entry.frame).second) << "twice: " << entry.frame;
  }
  return frames;
}

TEST_F(PostgresMap, NamesRemediesAndNeverThePassword) {
  writer();
  server_->execute("CREATE ROLE guest LOGIN PASSWORD 'right'");
  const auto rejected = [&](const std::string& url, const char* what) {
    const std::string message =
        message_of<Error>([&] { open_map(url, MapAccess::kWrite, &kOfServer); });
    EXPECT_NE(message.find(what), std::string::npos) << message;
    EXPECT_EQ(message.find("sesame"), std::string::npos) << message;
  };
  rejected(server_->url("town", "guest:sesame"), "check the user and the password");
  rejected(server_->url("town", "guest:right"), "the server denies access");
  rejected(server_->url("town", "postgres:sesame", "none"), "createdb");
  rejected("postgresql://me:sesame@/x?host=/nowhere", "check that a PostgreSQL server runs");
  rejected("postgresql://me:sesame@h:port/x", "no connection");
  rejected(server_->url("Town"), "map=Town");
  rejected(server_->url("town") + "&patience=x", "patience=x");
  server_->execute("CREATE SCHEMA odd; CREATE TABLE odd.map (x INTEGER)");
  rejected(server_->url("odd"), "another program's tables");
  // A server that accepts the connection and does not answer.
  const int silent = ::socket(AF_INET, SOCK_STREAM, 0);
  ASSERT_EQ(::listen(silent, 1), 0);
  sockaddr_in at{};
  socklen_t size = sizeof(at);
  ASSERT_EQ(::getsockname(silent, reinterpret_cast<sockaddr*>(&at), &size), 0);
  rejected(str("postgresql://me:sesame@127.0.0.1:", ntohs(at.sin_port), "/x?patience=1"),
           "check that a PostgreSQL server runs");
  ::close(silent);
}

TEST_F(PostgresMap, EndsAStatementThatIsNeverAnswered) {
  const auto holder = writer();
  holder->add(made_entries(1, 1));
  const auto impatient = open_map(server_->url("town") + "&patience=0", MapAccess::kWrite);
  const auto describe = [&](const MapEntry& entry) {
    expect_error<Error>([&] { impatient->add(made_entries(2, 2)); }, {"does not answer"});
    return entry.descriptor;
  };
  EXPECT_TRUE(holder->replace_descriptors(describe, {}, 0));
  EXPECT_EQ(impatient->add(made_entries(2, 2)), std::vector<int64_t>{2});
}

/// A reader that refreshes on notifications misses no entry.
TEST_F(PostgresMap, KeepsEachChangeOnceAfterAKilledServer) {
  constexpr int64_t kFrames = 120;
  writer()->add(made_entries(1, kFrames));
  const auto watcher = reader();
  int64_t last = read_all(*watcher).state.last;
  EXPECT_FALSE(watcher->has_updates());
  std::atomic<int64_t> changes = 0;
  std::vector<std::thread> threads;
  for (const char* drive : {"a", "b", "removes"})
    threads.emplace_back([this, drive, &changes] {
      const auto map = writer();
      for (int64_t i = 1; i <= kFrames; ++i) {
        const MapEntry entry = made_entry(drive, i);
        EXPECT_EQ(*drive == 'r' ? map->remove({&i, 1}) : map->add({&entry, 1}).size(), 1);
        ++changes;
      }
    });
  for (int kill = 1; kill <= 4; ++kill) {
    while (changes < kill * kFrames * 3 / 4) {
      ASSERT_TRUE(gets_updates(*watcher));
      for (const MapEntry& entry : read_all(*watcher, last).entries) ASSERT_EQ(entry.id, ++last);
    }
    if (kill == 2)  // connections only
      server_->execute(
          "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid() "
          "AND backend_type = 'client backend'");
    else if (kill < 4)
      restart();
  }
  for (std::thread& robot : threads) robot.join();
  auto frames = frames_of(*watcher);
  EXPECT_EQ(frames["a"].size(), kFrames);
  EXPECT_EQ(frames["b"].size(), kFrames);
  EXPECT_EQ(watcher->removed().size(), kFrames);
  EXPECT_EQ(check_map(server_->url("town")), std::vector<std::string>());

  server_->kill();
  expect_error<Error>([&] { reader(); }, {"no connection", "server runs"});
}

TEST_F(PostgresMap, ClaimsEndWithTheirConnection) {
  using Frames = std::vector<int64_t>;
  const auto a = writer(), b = writer();
  const Frames frames = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9};
  expect_error<UsageError>([&] { a->claim("x", frames, 0); }, {"at least 1"});
  const std::string cut("x\0y", 3);  // a server would truncate it to x
  expect_error<UsageError>([&] { a->claim(cut, frames, 1); }, {"zero byte"});
  EXPECT_EQ(a->claim("x", frames, 3), (Frames{0, 1, 2}));
  EXPECT_EQ(b->claim("x", frames, 3), (Frames{3, 4, 5}));
  EXPECT_EQ(reader()->size(), 0);
  read_all(*a);
  const MapEntry first = made_entry("x", 0);
  EXPECT_EQ(a->add({&first, 1}, 0), Frames{1});
  EXPECT_FALSE(a->has_updates());                       // not for its own changes
  EXPECT_EQ(b->claim("y", frames, 2), (Frames{0, 1}));  // ends the other claim
  EXPECT_TRUE(b->has_updates());
  EXPECT_EQ(writer()->claim("x", frames, 9), (Frames{3, 4, 5, 6, 7, 8, 9}));
  server_->execute(
      "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid() AND "
      "backend_type = 'client backend'");
  expect_error<ClaimLost>([&] { a->add({&first, 1}, 0); }, {"claimed again"});
  EXPECT_EQ(b->claim("x", frames, 3), (Frames{0, 1, 2}));
  const std::vector<MapEntry> entries = {made_entry("x", 1), made_entry("x", 2)};
  EXPECT_EQ(b->add(entries, 0), (Frames{2, 3}));
  EXPECT_EQ(frames_of(*a)["x"], (std::set<int64_t>{0, 1, 2}));
}

TEST(ServerAddress, PatienceLimitsConnecting) {
  const auto url = [](const char* patience) {
    return postgres::parse_address(str("postgresql://h/d?patience=", patience)).url;
  };
  EXPECT_HAS(url("0"), "?connect_timeout=2&");
  EXPECT_HAS(url("2.001"), "?connect_timeout=3&");
  EXPECT_HAS(url("1000000"), "?connect_timeout=1000000&");
}

TEST(ServerAddress, NameHasNoPassword) {
  for (const auto& [where, password, name] :
       {std::tuple("postgresql://me:a?b:c@h/d?map=town", "a?b:c", "postgresql://me@h/d?map=town"),
        {"postgresql://me:p@h?password=q", "q", "postgresql://me@h"},
        {"postgresql://me@h/d?map=x", "", "postgresql://me@h/d?map=x"},
        {"postgresql:///d?host=/tmp/a@b:c", "", "postgresql:///d?host=/tmp/a@b:c"}}) {
    const postgres::Address address = postgres::parse_address(where);
    EXPECT_EQ(address.password, password) << where;
    EXPECT_EQ(address.name, name) << where;
  }
}

Description scan_at(const Map& map, int64_t frame) {
  const auto angle = static_cast<float>(frame);
  PointCloud cloud;
  for (int i = 0; i < 2; ++i)
    cloud.points.push_back({10 * std::sin(angle), 10 * std::cos(angle), std::sin(7 * angle), 0});
  return map.describe(view_of(cloud));
}

std::unique_ptr<Map> robot(const std::string& url) {
  const MapOptions options{.warmup = 30};
  const MapFingerprint fingerprint = fingerprint_of(coordinates(), options);
  return std::make_unique<Map>(coordinates(), options,
                               open_map(url, MapAccess::kWrite, &fingerprint));
}

TEST_F(PostgresMap, CopiedProjectionsReachOpenRecognizers) {
  const TempDir folder;
  const std::string url = server_->url("town"), other = folder / "other.map";
  const auto fill = [](Map& one, int64_t first) {
    for (int64_t frame = first; frame < first + 30; ++frame)
      one.add({{.frame = frame, .feature = scan_at(one, frame).feature}});
  };
  fill(*robot(other), 0);
  const auto early = robot(url);
  const auto take_over = [&] {
    copy_projection(*open_map(url, MapAccess::kWrite), other,
                    [](const std::string& problem) { ADD_FAILURE() << problem; });
  };
  std::thread another(take_over);
  take_over();
  another.join();
  fill(*early, 100);
  const auto map = open_map(url, MapAccess::kRead);
  EXPECT_EQ(map->value(kProjectionValue),
            open_map(other, MapAccess::kRead)->value(kProjectionValue));
  for (const MapEntry& entry : read_all(*map).entries) EXPECT_TRUE(entry.feature.empty());
}

TEST_F(PostgresMap, RecognizersShareEntries) {
  const std::string url = server_->url("town");
  const auto a = robot(url), b = robot(url);
  // Robots alternate, during and after the warm-up; each knows the indices of its own entries.
  for (int64_t frame = 0; frame < 40; ++frame) {
    const Description scan = scan_at(*a, frame);
    EXPECT_EQ(a->add({{.drive = "a", .frame = frame, .feature = scan.feature}}),
              std::vector<int64_t>{2 * frame});
    for (int tries = 0; b->size() <= 2 * frame && tries < 5000; ++tries) {
      b->refresh();
      std::this_thread::sleep_for(milliseconds(1));
    }
    const auto seen = b->query(scan);
    EXPECT_TRUE(frame < 4 || (seen && seen->drive == "a" && seen->index == 2 * frame));
    const std::vector<float> next = scan_at(*b, 1000 + frame).feature;
    EXPECT_EQ(b->add({{.drive = "b", .frame = 1000 + frame, .feature = next}}),
              std::vector<int64_t>{2 * frame + 1});
  }
  EXPECT_EQ(b->size(), 80);
  // A third robot, which was offline, adds a batch beyond the end of the warm-up.
  const std::string second = server_->url("village");
  std::vector<std::thread> robots;
  for (int r = 0; r < 3; ++r)
    robots.emplace_back([&second, r] {
      const auto one = robot(second);
      for (int64_t frame = 100 * r; frame < 100 * r + 25; ++frame) {
        const Description scan = scan_at(*one, frame);
        const int64_t index = one->add({{.frame = frame, .feature = scan.feature}}).front();
        const auto found = one->query(scan);
        EXPECT_TRUE(frame % 100 < 4 || (found && found->index == index));
      }
    });
  for (std::thread& one : robots) one.join();
  const auto whole = robot(second);
  EXPECT_EQ(whole->size(), 75);
  for (int r = 0; r < 3; ++r)
    EXPECT_EQ(whole->query(scan_at(*whole, 100 * r + 7))->frame, 100 * r + 7);
  EXPECT_EQ(check_map(second), std::vector<std::string>());
  const auto map = open_map(second, MapAccess::kRead);
  EXPECT_EQ(read_all(*map).state.revision, 1);
  for (const MapEntry& entry : read_all(*map).entries) EXPECT_TRUE(entry.feature.empty());
}

}  // namespace
}  // namespace revisit
