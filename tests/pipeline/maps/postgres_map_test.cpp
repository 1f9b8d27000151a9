#include "postgres_map.h"

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include "coordinates.h"
#include "maps.h"
#include "postgres_server.h"
#include "testing.h"

namespace revisit {
namespace {

class PostgresMap : public ::testing::Test {
 protected:
  void SetUp() override {
    if (const std::string why = PostgresServer::missing(); !why.empty()) GTEST_SKIP() << why;
    server_ = &PostgresServer::without_maps();
    town_ = server_->url("town");
  }
  PostgresServer* server_ = nullptr;
  std::string town_;
};

TEST_F(PostgresMap, NamesRemediesAndNeverThePassword) {
  writer_of(town_);
  server_->execute("CREATE ROLE guest LOGIN PASSWORD 'right'");
  const auto rejected = [&](const std::string& url, const char* what) {
    const std::string message = message_of<Error>([&] { writer_of(url); });
    EXPECT_HAS(message, what);
    EXPECT_EQ(message.find("sesame"), std::string::npos) << message;
  };
  rejected(server_->url("town", "guest:sesame"), "check the user and the password");
  rejected(server_->url("town", "guest:right"), "the server denies access");
  rejected(server_->url("town", "postgres:sesame", "none"), "createdb");
  rejected("postgresql://me:sesame@/x?host=/nowhere", "check that a PostgreSQL server runs");
  rejected("postgresql://me:sesame@h:port/x", "no connection");
  rejected(server_->url("Town"), "map=Town");
  rejected(town_ + "&patience=x", "patience=x");
  server_->execute(
      "CREATE SCHEMA odd; CREATE TABLE odd.map (x INTEGER); CREATE SCHEMA other; CREATE TABLE "
      "other.entry (id INTEGER)");
  rejected(server_->url("odd"), "another program's tables");
  rejected(server_->url("other"), "tables, but not a map");
  EXPECT_EQ(check_map(server_->url("other")).size(), 1);
  EXPECT_EQ(server_->execute("SELECT tablename FROM pg_tables WHERE schemaname = 'other'"),
            "entry\n");
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
  const auto holder = writer_of(town_);
  holder->add(made_entries(1, 1));
  const auto impatient = writer_of(town_ + "&patience=0");
  const auto describe = [&](const MapEntry& entry) {
    expect_error<Error>([&] { impatient->add(made_entries(2, 2)); }, {"does not answer"});
    return entry.descriptor;
  };
  EXPECT_TRUE(holder->replace_descriptors(describe, {}, 0));
  EXPECT_EQ(impatient->add(made_entries(2, 2)), std::vector<int64_t>{2});
}

TEST_F(PostgresMap, ClaimsEndWithTheirConnection) {
  using Frames = std::vector<int64_t>;
  const auto a = writer_of(town_), b = writer_of(town_);
  const Frames frames = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9};
  expect_error<UsageError>([&] { a->claim("x", frames, 0); }, {"at least 1"});
  const std::string cut("x\0y", 3);  // a server would truncate it to x
  expect_error<UsageError>([&] { a->claim(cut, frames, 1); }, {"zero byte"});
  EXPECT_EQ(a->claim("x", frames, 3), (Frames{0, 1, 2}));
  EXPECT_EQ(b->claim("x", frames, 3), (Frames{3, 4, 5}));
  EXPECT_EQ(reader_of(town_)->size(), 0);
  const MapEntry first = made_entry("x", 0);
  EXPECT_EQ(a->add({&first, 1}, 0), Frames{1});
  EXPECT_EQ(b->claim("y", frames, 2), (Frames{0, 1}));  // ends the other claim
  EXPECT_EQ(writer_of(town_)->claim("x", frames, 9), (Frames{3, 4, 5, 6, 7, 8, 9}));
  server_->close_connections("backend_type = 'client backend'");
  expect_error<ClaimLost>([&] { a->add({&first, 1}, 0); }, {"claimed again"});
  EXPECT_EQ(b->claim("x", frames, 3), (Frames{0, 1, 2}));
  EXPECT_EQ(b->add(std::vector{made_entry("x", 1), made_entry("x", 2)}, 0), (Frames{2, 3}));
  const ReadMap read = read_all(*a);
  ASSERT_EQ(read.entries.size(), 3);
  for (int64_t frame = 0; frame < 3; ++frame)
    EXPECT_TRUE(same(read.entries[frame], made_entry("x", frame)));
}

TEST(ServerAddress, HasATimeoutAndAName) {
  for (const auto& [where, password, name, timeout] :
       {std::tuple("postgresql://me:a?b:c@h/d?map=x", "a?b:c", "postgresql://me@h/d?map=x", 10),
        {"postgresql://me:p@h?password=q", "q", "postgresql://me@h", 10},
        {"postgresql:///d?host=/tmp/a@b:c", "", "postgresql:///d?host=/tmp/a@b:c", 10},
        {"postgresql://me@h/d?patience=0", "", "postgresql://me@h/d?patience=0", 2},
        {"postgresql://h?patience=2.001", "", "postgresql://h?patience=2.001", 3},
        {"postgresql://h?patience=1000000", "", "postgresql://h?patience=1000000", 1000000}}) {
    const postgres::Address address = postgres::parse_address(where);
    EXPECT_EQ(address.password, password) << where;
    EXPECT_EQ(address.name, name) << where;
    EXPECT_HAS(address.url, str("?connect_timeout=", timeout, "&"));
  }
}

Description scan_at(int64_t frame) {
  const auto angle = static_cast<float>(frame);
  return {.feature = {std::sin(angle), std::cos(angle), std::sin(7 * angle), 0, 0, 1}, .error = ""};
}

std::unique_ptr<Map> robot(const fs::path& map) {
  return file_map(map, coordinates(), {.warmup = 30});
}

/// Each robot knows the indices of its own entries. Either the warm-up ends meanwhile, or the
/// projection of another map was copied, by two processes at once.
TEST_F(PostgresMap, RecognizersShareEntries) {
  for (const char* name : {"town", "copied"}) {
    const std::string url = server_->url(name);
    std::array robots = {robot(url), robot(url), robot(url)};
    const auto in_parallel = [](const std::function<void(int64_t)>& work) {
      std::vector<std::thread> threads;
      for (int64_t i = 0; i < 3; ++i) threads.emplace_back([&work, i] { work(i); });
      for (std::thread& thread : threads) thread.join();
    };
    const TempDir folder;
    const std::string other = folder / "other";
    if (name == std::string("copied")) {
      const auto early = robot(other);
      for (int64_t frame = 300; frame < 330; ++frame) add_scan(*early, scan_at(frame));
      in_parallel([&](int64_t) {
        copy_projection(*open_map(url, MapAccess::kWrite), other,
                        [](const std::string& problem) { ADD_FAILURE() << problem; });
      });
    }
    in_parallel([&](int64_t r) {
      for (int64_t frame = 100 * r; frame < 100 * r + 25; ++frame) {
        const int64_t index = add_scan(*robots[r], scan_at(frame), {.frame = frame});
        const auto found = robots[r]->query(scan_at(frame));
        EXPECT_TRUE(frame % 100 < 4 || (found && found->index == index));
      }
    });
    const auto whole = robot(url);
    EXPECT_EQ(whole->size(), 75);
    for (const int64_t frame : {7, 107, 207}) EXPECT_EQ(whole->query(scan_at(frame))->frame, frame);
    EXPECT_EQ(check_map(url), std::vector<std::string>());
    const ReadMap read = read_all(*reader_of(url));
    for (const MapEntry& entry : read.entries) EXPECT_TRUE(entry.feature.empty());
    if (name == std::string("town"))
      EXPECT_EQ(read.state.revision, 1);
    else
      EXPECT_EQ(reader_of(url)->value(kProjectionValue), reader_of(other)->value(kProjectionValue));
  }
}

}  // namespace
}  // namespace revisit
