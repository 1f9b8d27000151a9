#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <clocale>
#include <cmath>
#include <csignal>
#include <cstring>
#include <numeric>
#include <set>
#include <thread>

#include "expect_error.h"
#include "postgres_server.h"
#include "read_map.h"
#include "removed_places.h"
#include "revisit/maps/place_recognizer.h"
#include "schema.h"
#include "server_address.h"

namespace revisit {
namespace {

using std::chrono::milliseconds;
using test::expect_error;
using test::PostgresServer;

const MapFingerprint kServedIdentity{{"feature", "numbers"}, {"weights", "sha256 0123"}};

class PostgresMap : public ::testing::Test {
 protected:
  void SetUp() override {
    if (const std::string why = PostgresServer::missing(); !why.empty()) GTEST_SKIP() << why;
    if (!server_) server_.emplace();
    server_->start();  // the preceding test may have killed it
    server_->forget_maps();
  }
  static void TearDownTestSuite() { server_.reset(); }
  std::unique_ptr<MapStore> writer(const std::string& map = "town",
                                   DescriptorType format = DescriptorType::kFloat32) {
    return open_map(server_->url(map), MapAccess::kWrite, &kServedIdentity, format);
  }
  std::unique_ptr<WorkQueue> work() { return open_work_queue(server_->url("town")); }
  std::unique_ptr<MapStore> reader(const std::string& map = "town") {
    return open_map(server_->url(map), MapAccess::kRead);
  }
  void restart() {
    server_->kill();
    server_->start();
  }
  static inline std::optional<PostgresServer> server_;  // shared, because starting it takes seconds
};

/// Values are exact in float16, too.
StoredPlace made(const std::string& drive, int64_t frame) {
  StoredPlace place;
  place.drive = drive;
  place.frame = frame;
  if (frame % 2 == 0) place.time = 1.6e9 + 0.1 * static_cast<double>(frame);
  if (frame % 4 != 0) {
    place.pose = Eigen::Isometry3d::Identity();
    place.pose->translation() = Eigen::Vector3d(static_cast<double>(frame), -1.0 / 3, 1e-300);
  }
  for (int64_t i = 0; i < 100; ++i)
    place.descriptor.push_back(static_cast<float>((frame * 37 + i) % 512 - 256) / 64);
  if (frame % 5 == 0) place.feature = {1.0F / 3, static_cast<float>(frame), 1e30F};
  return place;
}

bool hears_of_news(MapStore& map) {
  for (int tries = 0; tries < 20'000; ++tries) {
    if (map.has_updates()) return true;
    std::this_thread::sleep_for(milliseconds(1));
  }
  return false;
}

/// Expects ids 1, 2, ... and every entry once, as it was made; returns the frames of each drive.
std::map<std::string, std::set<int64_t>> frames_of(const MapStore& map) {
  const WhatWasRead read = read_all(map);
  EXPECT_EQ(read.damages, std::vector<std::string>());
  std::map<std::string, std::set<int64_t>> frames;
  int64_t id = 0;
  for (const StoredPlace& place : read.places) {
    EXPECT_EQ(place.id, ++id);
    EXPECT_TRUE(same(place, made(place.drive, place.frame))) << id;
    EXPECT_TRUE(frames[place.drive].insert(place.frame).second) << "twice: " << place.frame;
  }
  return frames;
}

TEST_F(PostgresMap, KeepsWhatItIsGiven) {
  for (const DescriptorType format : {DescriptorType::kFloat32, DescriptorType::kFloat16}) {
    const std::string name = format == DescriptorType::kFloat32 ? "a" : "b";
    {
      const auto map = writer(name, format);
      EXPECT_EQ(map->size(), 0);
      EXPECT_EQ(map->add({}), std::vector<int64_t>());
      for (int64_t i = 1; i <= 280; i += 140) {
        std::vector<StoredPlace> places;
        for (int64_t frame = i; frame < i + 140; ++frame) places.push_back(made("x", frame));
        EXPECT_EQ(map->add(places).back(), i + 139);
      }
      map->set_value("basis", std::string(20'000, '\1'));
      map->set_value("bytes", "0.5");
      map->set_value("bytes", std::string("0.\0", 3));
    }
    const auto map = reader(name);
    EXPECT_EQ(frames_of(*map)["x"].size(), 280);
    EXPECT_EQ(map->size(), 280);
    EXPECT_EQ(map->fingerprint(), kServedIdentity);
    EXPECT_EQ(map->descriptor_type(), format);
    EXPECT_EQ(map->value("basis"), std::string(20'000, '\1'));
    EXPECT_EQ(map->value("bytes"), std::string("0.\0", 3));
    EXPECT_EQ(map->value("none"), std::nullopt);
    EXPECT_EQ(read_all(*map, 277).places.size(), 3);
    expect_error<UsageError>([&] { map->set_value("a", ""); }, {"for reading"});

    const auto other = writer(name);
    const auto shorter = [](const StoredPlace& place) {
      return std::vector<float>{static_cast<float>(place.id), 0.5F};
    };
    EXPECT_TRUE(other->replace_descriptors(shorter, {{"basis", "b"}}, 0));
    EXPECT_FALSE(other->replace_descriptors(shorter, {{"basis", "c"}}, 0));
    const StoredPlace late = made("x", 281);
    EXPECT_TRUE(other->add({&late, 1}, 0).empty());
    EXPECT_EQ(other->add({&late, 1}, 1), std::vector<int64_t>{281});
    const WhatWasRead read = read_all(*map);
    EXPECT_EQ(read.position.revision, 1);
    EXPECT_EQ(read.places.at(9).descriptor, (std::vector<float>{10, 0.5F}));
    EXPECT_TRUE(read.places.at(9).feature.empty());
    EXPECT_EQ(map->value("basis"), "b");
    EXPECT_EQ(check_map(server_->url(name)), std::vector<std::string>());
  }
  server_->execute("UPDATE a.place SET frame = 0 WHERE id = 7; DELETE FROM a.place WHERE id = 9");
  const WhatWasRead read = read_all(*reader("a"));
  EXPECT_EQ(read.places.size(), 279);
  ASSERT_EQ(read.damages.size(), 2);
  EXPECT_NE(read.damages[0].find("place 7 is corrupt: its checksum"), std::string::npos);
  EXPECT_HAS(read.damages[1], "it has 280 places after place 0, expected 281");
}

TEST_F(PostgresMap, MergingNeedsANewMap) {
  const test::TempDir folder;
  const auto theirs = open_map(folder / "a.map", MapAccess::kWrite, &kServedIdentity);
  const StoredPlace place = made("x", 1);
  theirs->add({&place, 1});
  theirs->set_value(kProjectionValue, "theirs");
  const std::filesystem::path maps[] = {folder / "a.map"};
  const auto merge_into = [&](const std::string& map) {
    return merge_maps(maps, server_->url(map), [](const std::string&) {});
  };
  const auto map = writer();  // an empty map exists, too
  expect_error<InputError>([&] { merge_into("town"); }, {"map=town", "already exists"});
  map->add({&place, 1});
  map->set_value(kProjectionValue, "mine");
  expect_error<InputError>([&] { merge_into("town"); }, {"already exists"});
  EXPECT_EQ(map->value(kProjectionValue), "mine");
  EXPECT_EQ(map->size(), 1);
  EXPECT_EQ(merge_into("village"), 1);
  EXPECT_EQ(reader("village")->value(kProjectionValue), "theirs");
}

TEST_F(PostgresMap, TimesDoNotDependOnTheLocale) {
  if (std::setlocale(LC_NUMERIC, "de_DE.UTF-8") == nullptr)
    GTEST_SKIP() << "no locale with a decimal comma";
  const StoredPlace place = made("x", 14);
  writer()->add({&place, 1});
  const auto read = read_all(*reader());
  std::setlocale(LC_NUMERIC, "C");
  EXPECT_EQ(read.places.at(0).time, place.time);
}

TEST_F(PostgresMap, ErrorsSayWhatToDoAndNeverThePassword) {
  writer();
  MapFingerprint other = kServedIdentity;
  other["weights"] = "sha256 4567";
  expect_error<InputError>([&] { open_map(server_->url("town"), MapAccess::kRead, &other); },
                           {"weights: the map has 'sha256 0123', this program 'sha256 4567'"});
  expect_error<InputError>([&] { reader("village"); }, {"there is no map 'village'"});
  server_->execute("CREATE ROLE guest LOGIN PASSWORD 'right'");
  const auto refused = [&](const std::string& url, const char* what) {
    const std::string message =
        test::message_of<Error>([&] { open_map(url, MapAccess::kWrite, &kServedIdentity); });
    EXPECT_NE(message.find(what), std::string::npos) << message;
    EXPECT_EQ(message.find("sesame"), std::string::npos) << message;
  };
  refused(server_->url("town", "guest:sesame"), "check the user and the password");
  refused(server_->url("town", "guest:right"), "the server denies access");
  refused(server_->url("town", "postgres:sesame", "none"), "createdb");
  refused("postgresql://me:sesame@/x?host=/nowhere", "check that a PostgreSQL server runs");
  refused("postgresql://me:sesame@h:port/x", "no connection");
  refused(server_->url("Town"), "map=Town");
  refused(server_->url("town") + "&patience=x", "patience=x");
  server_->execute("CREATE SCHEMA odd; CREATE TABLE odd.map (x INTEGER)");
  refused(server_->url("odd"), "another program's tables");
  // A server that accepts the connection and does not answer.
  const int silent = ::socket(AF_INET, SOCK_STREAM, 0);
  ASSERT_EQ(::listen(silent, 1), 0);
  sockaddr_in at{};
  socklen_t size = sizeof(at);
  ASSERT_EQ(::getsockname(silent, reinterpret_cast<sockaddr*>(&at), &size), 0);
  refused(str("postgresql://me:sesame@127.0.0.1:", ntohs(at.sin_port), "/x?patience=1"),
          "check that a PostgreSQL server runs");
  ::close(silent);
}

TEST_F(PostgresMap, RobotsAddAtOnceAndOthersAreTold) {
  writer();
  const auto watcher = reader();
  read_all(*watcher);
  EXPECT_FALSE(watcher->has_updates());
  std::vector<std::thread> robots;
  for (const char* drive : {"a", "b", "c"})
    robots.emplace_back([this, drive] {
      const auto map = writer();
      for (int64_t frame = 1; frame <= 40; ++frame) {
        const StoredPlace place = made(drive, frame);
        map->add({&place, 1});
      }
    });
  // A reader that refreshes on notifications misses no entry.
  int64_t last = 0;
  while (last < 120) {
    ASSERT_TRUE(hears_of_news(*watcher));
    const WhatWasRead read = read_all(*watcher, last);
    for (const StoredPlace& place : read.places) ASSERT_EQ(place.id, ++last);
  }
  for (std::thread& robot : robots) robot.join();
  EXPECT_EQ(frames_of(*watcher).size(), 3);

  const auto map = writer();
  read_all(*map);
  const StoredPlace place = made("d", 1);
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < 100; ++i) map->add({&place, 1});
  const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - begin;
  RecordProperty("added_per_second", static_cast<int>(100 / taken.count()));
  EXPECT_FALSE(map->has_updates());  // not for its own changes
}

/// Reports each acknowledged frame until it is killed.
[[noreturn]] void add_for_ever(const std::string& url, const std::string& drive, int pipe) {
  try {
    const auto map = open_map(url, MapAccess::kWrite, &kServedIdentity);
    for (int64_t frame = 1;; ++frame) {
      const StoredPlace place = made(drive, frame);
      map->add({&place, 1});
      if (::write(pipe, &frame, sizeof(frame)) != sizeof(frame)) break;
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
  }
  std::_Exit(1);
}

TEST_F(PostgresMap, AKilledWorkerLosesNothingThatWasAcknowledged) {
  std::map<std::string, int64_t> acknowledged;
  for (int kill = 0; kill < 10; ++kill) {
    const std::string drive = std::to_string(kill);
    int ends[2];
    ASSERT_EQ(::pipe(ends), 0);
    const pid_t child = ::fork();
    if (child == 0) add_for_ever(server_->url("town"), drive, ends[1]);
    ::close(ends[1]);
    int64_t frame = 0;
    for (int i = 0; i < kill % 4; ++i)
      if (::read(ends[0], &frame, sizeof(frame)) == sizeof(frame)) acknowledged[drive] = frame;
    ::usleep(static_cast<useconds_t>(kill * 7919 % 20'000));
    ::kill(child, SIGKILL);
    while (::read(ends[0], &frame, sizeof(frame)) == sizeof(frame)) acknowledged[drive] = frame;
    ::close(ends[0]);
    int status = 0;
    ::waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status)) << "the writer ended by itself";
  }
  const auto map = writer();
  auto frames = frames_of(*map);
  for (const auto& [drive, last] : acknowledged) {
    const auto there = static_cast<int64_t>(frames[drive].size());
    EXPECT_GE(there, last);
    EXPECT_LE(there, last + 1);
  }
  EXPECT_GT(acknowledged.size(), 4);
}

TEST_F(PostgresMap, AKilledServerLosesNothingAndNothingIsThereTwice) {
  writer();
  constexpr int64_t kFrames = 120;
  std::atomic<int64_t> added = 0;
  std::vector<std::thread> robots;
  for (const char* drive : {"a", "b"})
    robots.emplace_back([this, drive, &added] {
      const auto map = writer();
      for (int64_t frame = 1; frame <= kFrames; ++frame) {
        const StoredPlace place = made(drive, frame);
        EXPECT_EQ(map->add({&place, 1}).size(), 1);
        ++added;
      }
    });
  const auto watcher = reader();
  for (int kill = 1; kill <= 2; ++kill) {
    while (added < kill * 70) std::this_thread::sleep_for(milliseconds(1));
    if (kill == 2)  // one connection only
      server_->execute(
          "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid() "
          "AND backend_type = 'client backend'");
    else
      restart();
    EXPECT_GE(watcher->size(), kill * 70);
    EXPECT_TRUE(watcher->has_updates());
  }
  for (std::thread& robot : robots) robot.join();
  auto frames = frames_of(*watcher);
  EXPECT_EQ(frames["a"].size(), kFrames);
  EXPECT_EQ(frames["b"].size(), kFrames);

  server_->kill();
  expect_error<Error>([&] { open_map(server_->url("town"), MapAccess::kRead); },
                      {"no connection", "server runs"});
}

std::vector<int64_t> frames_to(int64_t n) {
  std::vector<int64_t> frames(static_cast<size_t>(n));
  std::iota(frames.begin(), frames.end(), 0);
  return frames;
}

std::vector<StoredPlace> places_of(const Claim& claim) {
  std::vector<StoredPlace> places;
  for (const int64_t frame : claim.frames)
    if (!claim.skipped.contains(frame)) places.push_back(made(claim.drive, frame));
  return places;
}

TEST_F(PostgresMap, ClaimsAreOfOneAndEndWithTheirConnection) {
  const auto map = writer();
  const auto a = work(), b = work();
  const StoredPlace there = made("x", 3);
  map->add({&there, 1});
  const std::vector<int64_t> frames = frames_to(10);
  a->enqueue("x", frames);
  b->enqueue("x", frames);
  EXPECT_EQ(b->pending("x"), 9);
  EXPECT_EQ(b->pending("y"), 0);
  EXPECT_EQ(a->claim("y", 1), nullptr);
  expect_error<UsageError>([&] { a->claim("x", 0); }, {"at least 1"});
  const std::string cut("x\0y", 3);  // a server would truncate it to x
  expect_error<UsageError>([&] { a->enqueue(cut, frames); }, {"zero byte"});
  expect_error<UsageError>([&] { a->claim(cut, 1); }, {"zero byte"});
  StoredPlace of_cut = there;
  of_cut.drive = cut;
  expect_error<UsageError>([&] { map->add({&of_cut, 1}); }, {"zero byte"});
  auto of_a = a->claim("x", 3), of_b = b->claim("x", 3);
  EXPECT_EQ(of_a->frames, (std::vector<int64_t>{0, 1, 2}));
  EXPECT_EQ(of_b->frames, (std::vector<int64_t>{4, 5, 6}));
  expect_error<UsageError>([&] { a->claim("x", 1); }, {"has not ended"});
  expect_error<UsageError>([&] { of_a->add({&there, 1}, 0); }, {"frame 3", "claim"});
  // Another revision leaves the claim valid.
  of_a->skipped[1] = "no points";
  EXPECT_TRUE(of_a->add(places_of(*of_a), 7).empty());
  server_->execute("SELECT 1 FROM town.counts FOR UPDATE NOWAIT");  // it holds no lock
  EXPECT_EQ(of_a->add(places_of(*of_a), 0), (std::vector<int64_t>{2, 3}));
  expect_error<UsageError>([&] { of_a->add({}, 0); }, {"has ended"});
  EXPECT_EQ(a->pending("x"), 6);
  of_a.reset();
  {
    const auto given_back = a->claim("x", 100);
    EXPECT_EQ(given_back->frames, (std::vector<int64_t>{7, 8, 9}));
    EXPECT_EQ(work()->claim("x", 1), nullptr);
  }
  server_->execute(
      "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE state = 'idle in transaction'");
  expect_error<ClaimLost>([&] { of_b->add(places_of(*of_b), 0); }, {"claimed again"});
  of_b = b->claim("x", 100);
  EXPECT_EQ(of_b->frames, (std::vector<int64_t>{4, 5, 6, 7, 8, 9}));
  of_b->add(places_of(*of_b), 0);
  of_b.reset();
  b->enqueue("x", frames);
  EXPECT_EQ(b->pending("x"), 0);
  EXPECT_EQ(frames_of(*map)["x"], (std::set<int64_t>{0, 2, 3, 4, 5, 6, 7, 8, 9}));
}

TEST_F(PostgresMap, RemovedPlacesAreGoneAndNeverTakenForLost) {
  const auto map = writer();
  std::vector<StoredPlace> places;
  for (int64_t frame = 1; frame <= 600; ++frame) places.push_back(made("x", frame));
  map->add(places);
  // Simulates an older map, which lacks the table.
  server_->execute("DROP TABLE town.removed");
  const auto watcher = reader();
  EXPECT_EQ(read_all(*watcher).position.removed, 0);
  EXPECT_EQ(map->remove(std::vector<int64_t>{600, 256, 257, 3}), 4);
  EXPECT_EQ(map->remove(std::vector<int64_t>{3, 4}), 1);
  EXPECT_EQ(map->remove(std::vector<int64_t>{3}), 0);
  expect_error<UsageError>([&] { map->remove(std::vector<int64_t>{601}); }, {"1 to 600"});
  expect_error<UsageError>([&] { watcher->remove(std::vector<int64_t>{5}); }, {"for reading"});
  ASSERT_TRUE(hears_of_news(*watcher));
  const WhatWasRead read = read_all(*watcher);
  EXPECT_EQ(read.damages, std::vector<std::string>());
  EXPECT_EQ(read.places.size(), 595);
  for (const StoredPlace& place : read.places)
    EXPECT_TRUE(place.frame == place.id && place.id != 3 && place.id != 256) << place.id;
  EXPECT_EQ(read.position.removed, 5);
  EXPECT_EQ(watcher->removed(4), std::vector<int64_t>{4});
  EXPECT_EQ(watcher->size(), 595);
  EXPECT_EQ(map->add({&places[0], 1}), std::vector<int64_t>{601});
  EXPECT_TRUE(
      map->replace_descriptors([](const StoredPlace& place) { return place.descriptor; }, {}, 0));
  EXPECT_EQ(read_all(*watcher).places.size(), 596);
  EXPECT_EQ(check_map(server_->url("town")), std::vector<std::string>());
}

TEST_F(PostgresMap, DamageIsSaid) {
  const auto map = writer();
  std::vector<StoredPlace> places;
  for (int64_t frame = 1; frame <= 300; ++frame) places.push_back(made("x", frame));
  map->add(places);
  map->remove(std::vector<int64_t>{50, 120});
  server_->execute("DELETE FROM town.place WHERE id > 100 AND id < 300");
  const std::string url = server_->url("town");
  const auto expect_said = [&](const char* what) {
    const std::vector<std::string> wrong = check_map(url);
    ASSERT_EQ(wrong.size(), 1);
    EXPECT_HAS(wrong[0], what);
  };
  expect_said("it has 100 places after place 0, expected 298; restore a copy");
  std::vector<int64_t> lost(199);
  std::iota(lost.begin(), lost.end(), 101);
  EXPECT_EQ(map->remove(lost), 198);
  EXPECT_EQ(check_map(url), std::vector<std::string>());
  EXPECT_EQ(map->size(), 100);
  server_->execute(
      str("INSERT INTO town.removed VALUES (1000, 7, ", removed_checksum(1000, 7), ")"));
  expect_said("it has 100 places after place 0, expected 99");
  server_->execute("UPDATE town.removed SET place = 8 WHERE id = 1000");
  EXPECT_HAS(check_map(url).back(), "a checksum in the list of removed places is wrong");
  server_->execute("DELETE FROM town.removed WHERE id = 1000");
  // Invalid content must not cause endless work.
  const auto say_that_there_are = [&](int64_t n) {
    server_->execute(str("UPDATE town.counts SET places = ", n,
                         ", checksum = ", checksum_of(Counts{.places = n})));
  };
  say_that_there_are(1'000'000'000'000);
  expect_said("it has 100 places after place 0, expected 999999999800");
  say_that_there_are(INT64_MAX);
  expect_said("the number of its places is wrong");
  expect_error<InputError>([&] { map->add({&places[0], 1}); }, {"the number of its places"});
}

TEST(ServerAddress, ConnectionsAreWaitedForAsLongAsItSays) {
  const auto url = [](const char* patience) {
    return postgres::parse_address(str("postgresql://h/d?patience=", patience)).url;
  };
  EXPECT_HAS(url("0"), "?connect_timeout=2&");
  EXPECT_HAS(url("2.001"), "?connect_timeout=3&");
  EXPECT_HAS(url("1000000"), "?connect_timeout=1000000&");
}

TEST(ServerAddress, KeepsThePasswordOutOfTheName) {
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

TEST_F(PostgresMap, ARemovedPlacesScanIsExpectedAgain) {
  const auto map = writer();
  const auto shared = work();
  const std::vector<int64_t> frames = frames_to(3);
  shared->enqueue("x", frames);
  {
    const auto claim = shared->claim("x", 10);
    claim->add(places_of(*claim), 0);
  }
  EXPECT_EQ(map->remove(std::vector<int64_t>{2}), 1);
  shared->enqueue("x", frames);
  EXPECT_EQ(shared->claim("x", 10)->frames, std::vector<int64_t>{1});
}

TEST_F(PostgresMap, RemovalsOutliveTheirProcessAndTheServer) {
  std::vector<StoredPlace> places;
  for (int64_t frame = 1; frame <= 300; ++frame) places.push_back(made("x", frame));
  writer()->add(places);
  std::atomic<int64_t> removed = 0;
  std::thread robot([&] {
    const auto map = writer();
    for (int64_t id = 1; id <= 200; ++id) {
      EXPECT_EQ(map->remove({&id, 1}), 1) << id;
      ++removed;
    }
  });
  for (int kill = 1; kill <= 2; ++kill) {
    while (removed < kill * 60) std::this_thread::sleep_for(milliseconds(1));
    restart();
  }
  robot.join();
  const auto map = reader();
  EXPECT_EQ(map->removed().size(), 200);
  EXPECT_EQ(read_all(*map).places.size(), 100);
  EXPECT_EQ(check_map(server_->url("town")), std::vector<std::string>());
}

[[noreturn]] void do_a_share(const std::string& url) {
  int code = 1;
  try {
    const auto shared = open_work_queue(url);
    while (shared->pending("x") > 0) {
      try {
        const auto claim = shared->claim("x", 5);
        if (claim == nullptr) {
          ::usleep(1000);
          continue;
        }
        const std::vector<StoredPlace> places = places_of(*claim);
        ::usleep(2000);
        claim->add(places, 0);
      } catch (const ClaimLost&) {
      }
    }
    code = 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
  }
  std::_Exit(code);
}

TEST_F(PostgresMap, KilledWorkersScansAreDoneByOthersOnce) {
  constexpr int64_t kFrames = 600;
  writer();
  work()->enqueue("x", frames_to(kFrames));
  const auto start = [&] {
    const pid_t child = ::fork();
    if (child == 0) do_a_share(server_->url("town"));
    return child;
  };
  std::vector<pid_t> workers = {start(), start()};
  for (int kill = 0; kill < 12; ++kill) {
    ::usleep(static_cast<useconds_t>(5000 + kill * 7919 % 20'000));
    if (kill == 6) restart();
    pid_t& one = workers[static_cast<size_t>(kill % 2)];
    ::kill(one, SIGKILL);
    int status = 0;
    ::waitpid(one, &status, 0);
    one = start();
  }
  for (const pid_t worker : workers) {
    int status = 0;
    ::waitpid(worker, &status, 0);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  }
  const auto map = writer();
  EXPECT_EQ(work()->pending("x"), 0);
  EXPECT_EQ(frames_of(*map)["x"].size(), kFrames);  // frames_of() checks that none is there twice
  EXPECT_EQ(map->size(), kFrames);
}

/// The projection subtracts the mean of the features.
FeatureExtractor three_coordinates() {
  FeatureExtractor extractor;
  extractor.name = extractor.key = "coordinates";
  extractor.dim = 3;
  extractor.make = []() -> FeatureFunction<PointCloud> {
    return [](const PointCloud& cloud, std::span<float> feature) {
      feature[0] = cloud.points[0].x;
      feature[1] = cloud.points[0].y;
      feature[2] = cloud.points[0].z;
    };
  };
  extractor.open_projection = [](const std::string& content) {
    std::vector<float> mean(3);
    std::memcpy(mean.data(), content.data(), content.size());
    Projection basis;
    basis.dim = 3;
    basis.describe = [mean](std::span<const float> feature, std::span<float> descriptor) {
      std::ranges::transform(feature, mean, descriptor.begin(), std::minus());
    };
    basis.content = content;
    return basis;
  };
  extractor.fit_projection = [open = extractor.open_projection](const Rows& features,
                                                                std::span<const int64_t> rows) {
    std::vector<float> mean(3);
    for (const int64_t row : rows)
      for (size_t i = 0; i < 3; ++i)
        mean[i] += features.row(row)[i] / static_cast<float>(rows.size());
    return open({reinterpret_cast<const char*>(mean.data()), 3 * sizeof(float)});
  };
  return extractor;
}

Description scan_at(const PlaceRecognizer& recognizer, int64_t frame) {
  const auto angle = static_cast<float>(frame);
  PointCloud cloud;
  cloud.points.push_back({10 * std::sin(angle), 10 * std::cos(angle), std::sin(7 * angle), 0});
  return recognizer.describe(view_of(cloud));
}

std::unique_ptr<PlaceRecognizer> robot(const std::string& url) {
  const RecognizerOptions options{.warmup = 30};
  const MapFingerprint identity = PlaceRecognizer::fingerprint_of(three_coordinates(), options);
  return std::make_unique<PlaceRecognizer>(three_coordinates(), options,
                                           open_map(url, MapAccess::kWrite, &identity));
}

TEST_F(PostgresMap, ABasisThatIsTakenOverHoldsForThoseWhoHaveOpenedTheMap) {
  const test::TempDir folder;
  const std::string url = server_->url("town"), other = folder / "other.map";
  const auto fill = [](PlaceRecognizer& one, int64_t first) {
    for (int64_t frame = first; frame < first + 30; ++frame)
      one.add(scan_at(one, frame), {.frame = frame});
  };
  fill(*robot(other), 0);
  const auto early = robot(url);
  const auto take_over = [&] {
    copy_projection(*open_map(url, MapAccess::kWrite), other,
                    [](const std::string& damage) { ADD_FAILURE() << damage; });
  };
  std::thread another(take_over);
  take_over();
  another.join();
  fill(*early, 100);
  const auto map = open_map(url, MapAccess::kRead);
  EXPECT_EQ(map->value(kProjectionValue),
            open_map(other, MapAccess::kRead)->value(kProjectionValue));
  for (const StoredPlace& place : read_all(*map).places) EXPECT_TRUE(place.feature.empty());
}

TEST_F(PostgresMap, RobotsRecognizeEachOthersPlaces) {
  const std::string url = server_->url("town");
  const auto a = robot(url), b = robot(url);
  // Robots alternate, during and after the warm-up; each knows the indices of its own entries.
  for (int64_t frame = 0; frame < 40; ++frame) {
    const Description scan = scan_at(*a, frame);
    const int64_t in_a = a->add(scan, {.drive = "a", .frame = frame});
    EXPECT_EQ(in_a, 2 * frame);
    for (int tries = 0; b->size() <= in_a && tries < 5000; ++tries) {
      b->refresh_if_updated();
      std::this_thread::sleep_for(milliseconds(1));
    }
    if (frame > 3) {
      const auto seen = b->query(scan);
      ASSERT_TRUE(seen);
      EXPECT_EQ(seen->drive, "a");
      EXPECT_EQ(seen->frame, frame);
      EXPECT_EQ(seen->index, in_a);
    }
    const int64_t own[] = {in_a};
    EXPECT_EQ(b->add(scan_at(*b, 1000 + frame), {.drive = "b", .frame = 1000 + frame}),
              2 * frame + 1);
    const auto other = b->query(scan, own);
    EXPECT_TRUE(!other || other->index != in_a);
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
        const int64_t position = one->add(scan, {.frame = frame});
        if (frame % 100 < 4) continue;
        const auto found = one->query(scan);
        ASSERT_TRUE(found);
        EXPECT_EQ(found->frame, frame);
        EXPECT_EQ(found->index, position);
      }
    });
  for (std::thread& one : robots) one.join();
  const auto whole = robot(second);
  EXPECT_EQ(whole->size(), 75);
  for (int r = 0; r < 3; ++r)
    EXPECT_EQ(whole->query(scan_at(*whole, 100 * r + 7))->frame, 100 * r + 7);
  EXPECT_EQ(check_map(second), std::vector<std::string>());
  const auto map = open_map(second, MapAccess::kRead);
  EXPECT_EQ(read_all(*map).position.revision, 1);
  for (const StoredPlace& place : read_all(*map).places) EXPECT_TRUE(place.feature.empty());
}

}  // namespace
}  // namespace revisit
