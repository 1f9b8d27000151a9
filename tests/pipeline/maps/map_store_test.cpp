#include "revisit/maps/map_store.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <csignal>
#include <cstring>
#include <limits>
#include <map>
#include <random>
#include <thread>

#include "execute_sql.h"
#include "expect_error.h"
#include "killed_writer.h"
#include "place_row.h"
#include "read_map.h"
#include "sqlite.h"
#include "test_data.h"
#include "writer_lock.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;
using test::execute_sql;
using test::expect_error;
using test::TempDir;

const MapFingerprint kIdentity{
    {"feature", "numbers"}, {"weights", "sha256 0123"}, {"image", "1024x64"}};

/// Values are exact in float16, too.
StoredPlace made(int64_t id) {
  StoredPlace place;
  place.id = id;
  if (id % 3 != 0) place.drive = "drive " + std::to_string(id % 3);
  place.frame = id * 10;
  if (id % 2 == 0) place.time = 1.6e9 + 0.1 * static_cast<double>(id);
  if (id % 4 != 0) {
    place.pose = Eigen::Isometry3d(
        Eigen::AngleAxisd(0.1 * static_cast<double>(id), Eigen::Vector3d(1, 2, 3).normalized()));
    place.pose->translation() = Eigen::Vector3d(static_cast<double>(id), -1.0 / 3, 1e-300);
  }
  for (int i = 0; i < 100; ++i)
    place.descriptor.push_back(static_cast<float>((id * 37 + i) % 512 - 256) / 64);
  if (id % 5 == 0) place.feature = {1.0F / 3, static_cast<float>(id), 1e30F};
  return place;
}

std::vector<StoredPlace> made_places(int64_t first, int64_t last) {
  std::vector<StoredPlace> places;
  for (int64_t id = first; id <= last; ++id) places.push_back(made(id));
  return places;
}

/// Expects entries 1 to `n` to be equal to made().
void expect_places(const MapStore& map, int64_t n) {
  const WhatWasRead read = read_all(map);
  EXPECT_EQ(read.damages, std::vector<std::string>());
  ASSERT_EQ(static_cast<int64_t>(read.places.size()), n);
  EXPECT_EQ(map.size(), n);
  for (int64_t id = 1; id <= n; ++id) {
    EXPECT_EQ(read.places[id - 1].id, id);
    EXPECT_TRUE(same(read.places[id - 1], made(id))) << id;
  }
}

std::unique_ptr<MapStore> writer_of(const fs::path& file) {
  return open_map(file, MapAccess::kWrite, &kIdentity);
}

bool in_another_process(const std::function<bool()>& work) {
  const pid_t child = ::fork();
  if (child == 0) {
    bool done = false;
    try {
      done = work();
    } catch (const std::exception& error) {
      std::fprintf(stderr, "%s\n", error.what());
    }
    std::_Exit(done ? 0 : 1);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

TEST(MapStore, RoundTrip) {
  for (const DescriptorType format : {DescriptorType::kFloat32, DescriptorType::kFloat16}) {
    const TempDir dir;
    const fs::path file = dir / "map";
    {
      const auto map = open_map(file, MapAccess::kWrite, &kIdentity, format);
      EXPECT_EQ(map->size(), 0);
      EXPECT_EQ(map->add(made_places(1, 20)), [] {
        std::vector<int64_t> ids(20);
        for (int64_t i = 0; i < 20; ++i) ids[i] = i + 1;
        return ids;
      }());
      EXPECT_EQ(map->add({}), std::vector<int64_t>());
      EXPECT_EQ(map->add(made_places(21, 21)), std::vector<int64_t>{21});
      map->set_value("basis", std::string(20'000, '\1'));
      map->set_value("bytes", "0.5");
      map->set_value("bytes", std::string("0.\0", 3));
      expect_places(*map, 21);
    }
    EXPECT_FALSE(fs::exists(file.string() + "-wal"));
    EXPECT_FALSE(fs::exists(file.string() + "-writer"));
    EXPECT_EQ(check_map(file), std::vector<std::string>());
    for (const MapAccess access : {MapAccess::kRead, MapAccess::kWrite}) {
      const auto map = open_map(file, access);
      expect_places(*map, 21);
      EXPECT_EQ(map->fingerprint(), kIdentity);
      EXPECT_EQ(map->descriptor_type(), format);
      EXPECT_EQ(map->value("basis"), std::string(20'000, '\1'));
      EXPECT_EQ(map->value("bytes"), std::string("0.\0", 3));
      EXPECT_EQ(map->value("none"), std::nullopt);
      EXPECT_EQ(read_all(*map, 18).places.size(), 3);
      EXPECT_EQ(read_all(*map, 21).position.last, 21);
    }
  }
}

TEST(MapStore, Float16RoundsByAsMuchAsItSays) {
  const TempDir dir;
  const auto map = open_map(dir / "map", MapAccess::kWrite, &kIdentity, DescriptorType::kFloat16);
  StoredPlace place;
  std::mt19937 random(1);
  std::uniform_real_distribution<float> exponent(-30, 15.9F);
  for (int i = 0; i < 10'000; ++i) place.descriptor.push_back(std::exp2(exponent(random)));
  map->add({&place, 1});
  const std::vector<float> kept = read_all(*map).places[0].descriptor;
  for (size_t i = 0; i < kept.size(); ++i)
    ASSERT_LE(std::abs(kept[i] - place.descriptor[i]),
              std::max(std::ldexp(place.descriptor[i], -11), std::ldexp(1.0F, -25)));
  place.descriptor = {65'600.0F};
  expect_error<UsageError>([&] { map->add({&place, 1}); }, {"65600", "float16"});
}

TEST(MapStore, RefusesWhatCannotBeKept) {
  const TempDir dir;
  const auto map = writer_of(dir / "map");
  const auto refused = [&](const std::function<void(StoredPlace&)>& spoil, const char* what) {
    std::vector<StoredPlace> places = made_places(1, 3);
    spoil(places[1]);
    expect_error<UsageError>([&] { map->add(places); }, {"place 2", what});
  };
  const double none = std::numeric_limits<double>::quiet_NaN();
  refused([&](StoredPlace& p) { p.descriptor[7] = static_cast<float>(none); }, "its descriptor");
  refused([&](StoredPlace& p) { p.feature = {INFINITY}; }, "its feature");
  refused([&](StoredPlace& p) { p.time = none; }, "its time");
  refused([&](StoredPlace& p) { p.drive = std::string("x\0y", 3); }, "'x' has a zero byte");
  refused(
      [&](StoredPlace& p) {
        p.pose.emplace(Eigen::Isometry3d::Identity()).translation().x() = none;
      },
      "its pose");
  EXPECT_EQ(map->size(), 0);
  const MapFingerprint odd{{"a=b", "c"}};
  expect_error<UsageError>([&] { open_map(dir / "other", MapAccess::kWrite, &odd); }, {"a=b"});
  const auto reader = open_map(dir / "map", MapAccess::kRead);
  expect_error<UsageError>([&] { reader->add(made_places(1, 1)); }, {"for reading"});
  expect_error<UsageError>([&] { reader->set_value("a", ""); }, {"for reading"});
  expect_error<UsageError>([&] { reader->replace_descriptors({}, {}, 0); }, {"for reading"});
}

TEST(MapStore, AnotherIdentityIsRefusedNamingEveryDifference) {
  const TempDir dir;
  writer_of(dir / "map");
  MapFingerprint other = kIdentity;
  other["weights"] = "sha256 4567";
  other.erase("image");
  other["code"] = "7";
  for (const MapAccess access : {MapAccess::kRead, MapAccess::kWrite})
    expect_error<InputError>(
        [&] { open_map(dir / "map", access, &other); },
        {"map: its descriptors", "weights: the map has 'sha256 0123', this program 'sha256 4567'",
         "image: the map has '1024x64', this program none",
         "code: the map has none, this program '7'"});
  EXPECT_EQ(test::message_of<InputError>([&] {
              open_map(dir / "map", MapAccess::kRead, &other);
            }).find("feature"),
            std::string::npos);
  expect_places(*open_map(dir / "map", MapAccess::kWrite, &kIdentity), 0);
}

TEST(MapStore, OneWriterAndAnyNumberOfReaders) {
  const TempDir dir;
  const mode_t mask = ::umask(0);
  const auto map = writer_of(dir / "map");
  ::umask(mask);
  EXPECT_EQ(fs::status(dir / "map-writer").permissions(), fs::perms(0666));
  const auto open_files = [] {
    return std::distance(fs::directory_iterator("/proc/self/fd"), fs::directory_iterator());
  };
  const auto refuse = [&] {
    expect_error<Error>([&] { writer_of(dir / "map"); }, {"map: another process is writing"});
  };
  // SQLite keeps one file descriptor, because closing it would release the writer's locks
  refuse();
  const auto before = open_files();
  refuse();
  EXPECT_EQ(open_files(), before);
  writer_of(dir / "other");
  EXPECT_EQ(open_files(), before);
  EXPECT_TRUE(in_another_process([&] {
    try {
      writer_of(dir / "map");
    } catch (const Error& error) {
      return std::string(error.what()).find("another process is writing") != std::string::npos;
    }
    return false;
  }));
  const auto early = open_map(dir / "map", MapAccess::kRead, &kIdentity);
  map->add(made_places(1, 5));
  EXPECT_EQ(read_all(*early).places.size(), 5);
  map->add(made_places(6, 7));
  const WhatWasRead more = read_all(*early, 5);
  ASSERT_EQ(more.places.size(), 2);
  EXPECT_TRUE(same(more.places[0], made(6)));
  EXPECT_EQ(more.position.last, 7);
  expect_places(*open_map(dir / "map", MapAccess::kRead), 7);
}

/// Closing any descriptor of a file releases all locks of the process on it; another program may
/// then remove the log in use.
TEST(MapStore, OpeningAMapAgainKeepsItsLocks) {
  const TempDir dir;
  const auto map = writer_of(dir / "map");
  map->add(made_places(1, 1));
  open_map(dir / "map", MapAccess::kRead);
  expect_error<Error>([&] { writer_of(dir / "map"); }, {"another process is writing"});
  EXPECT_TRUE(in_another_process([&] {
    const int file = ::open((dir / "map").c_str(), O_RDWR);
    struct flock lock {};
    lock.l_type = F_WRLCK;
    return ::fcntl(file, F_GETLK, &lock) == 0 && lock.l_type == F_RDLCK;
  }));
}

/// A process may open the lock file while another one, that ends, removes it.
TEST(MapStore, NeverTwoHaveTheLockOfWriters) {
  const TempDir dir;
  std::atomic<int> inside = 0, together = 0;
  const auto compete = [&] {
    for (int won = 0; won < 100;) try {
        const WriterLock lock(dir / "map", "map");
        if (++inside > 1) ++together;
        ++won;
        std::this_thread::yield();
        --inside;
      } catch (const Error&) {
      }
  };
  std::vector<std::thread> threads;
  for (int t = 0; t < 3; ++t) threads.emplace_back(compete);
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(together, 0);
}

TEST(MapStore, AProgramWithoutStandardInputWrites) {
  const TempDir dir;
  EXPECT_TRUE(in_another_process([&] {
    ::close(0);
    writer_of(dir / "map");
    return true;
  }));
}

TEST(MapStore, ReadersReadWhileAWriterWrites) {
  const TempDir dir;
  const auto map = writer_of(dir / "map");
  std::atomic<bool> done = false;
  std::thread reader([&] {
    const auto other = open_map(dir / "map", MapAccess::kRead);
    int64_t last = 0;
    while (!done || last < 400) {
      const WhatWasRead read = read_all(*other, last);
      EXPECT_TRUE(read.damages.empty());
      for (const StoredPlace& place : read.places) EXPECT_TRUE(same(place, made(++last)));
    }
  });
  for (int64_t id = 1; id <= 400; id += 2) map->add(made_places(id, id + 1));
  done = true;
  reader.join();
}

TEST(MapStore, DescriptorsAreReplacedInOneStep) {
  const TempDir dir;
  const auto map = writer_of(dir / "map");
  map->add(made_places(1, 30));
  const auto reader = open_map(dir / "map", MapAccess::kRead);
  EXPECT_EQ(read_all(*reader).position.revision, 0);
  const auto shorter = [](const StoredPlace& place) {
    EXPECT_TRUE(same(place, made(place.id)));
    return std::vector<float>{static_cast<float>(place.id), 0.5F};
  };
  EXPECT_THROW(map->replace_descriptors(
                   [](const StoredPlace& place) {
                     if (place.id == 20) throw std::runtime_error("no");
                     return std::vector<float>{};
                   },
                   {{"basis", "b"}}, 0),
               std::runtime_error);
  expect_places(*map, 30);
  EXPECT_EQ(map->value("basis"), std::nullopt);
  EXPECT_TRUE(map->replace_descriptors(shorter, {{"basis", "b"}, {"bytes", "t"}}, 0));
  EXPECT_FALSE(map->replace_descriptors(shorter, {{"basis", "c"}}, 0));
  EXPECT_TRUE(map->add(made_places(31, 31), 0).empty());
  const WhatWasRead read = read_all(*reader);
  EXPECT_EQ(read.position.revision, 1);
  ASSERT_EQ(read.places.size(), 30);
  for (const StoredPlace& place : read.places) {
    StoredPlace wanted = made(place.id);
    wanted.descriptor = {static_cast<float>(place.id), 0.5F};
    wanted.feature.clear();
    EXPECT_TRUE(same(place, wanted));
  }
  EXPECT_EQ(reader->value("basis"), "b");
  EXPECT_EQ(reader->value("bytes"), "t");
  map->add(made_places(31, 31));
  EXPECT_TRUE(same(read_all(*reader, 30).places.at(0), made(31)));
  EXPECT_EQ(check_map(dir / "map"), std::vector<std::string>());
}

TEST(MapStore, WhatIsNoMapIsRefused) {
  const TempDir dir;
  const auto refused = [&](const fs::path& file, std::initializer_list<std::string> parts) {
    expect_error<InputError>([&] { open_map(file, MapAccess::kRead); }, parts);
    expect_error<InputError>([&] { open_map(file, MapAccess::kWrite); }, parts);
  };
  refused(dir / "missing", {"missing: there is no such map"});
  EXPECT_FALSE(fs::exists(dir / "missing"));
  EXPECT_FALSE(fs::exists(dir / "missing-writer"));
  refused(dir.path(), {"not a regular file"});
  test::write_file(dir / "empty", "");
  refused(dir / "empty", {"empty: not a map: the file is empty"});
  test::write_file(dir / "text", std::string(10'000, 'x'));
  refused(dir / "text", {"text: not a map"});
  expect_error<InputError>([&] { writer_of(dir / "text"); }, {"text: not a map"});
  EXPECT_EQ(test::read_file(dir / "text"), std::string(10'000, 'x'));
  execute_sql(dir / "other", "CREATE TABLE place (id INTEGER PRIMARY KEY)");
  refused(dir / "other", {"other: a SQLite database, but not a map"});
  EXPECT_EQ(check_map(dir / "other").size(), 1);

  writer_of(dir / "later");
  execute_sql(dir / "later", "PRAGMA user_version = 4");
  refused(dir / "later", {"later: map version 4 (expected at most 3)"});
  writer_of(dir / "odd");
  execute_sql(dir / "odd", "CREATE VIEW v AS SELECT * FROM place");
  refused(dir / "odd", {"odd: this map is corrupt: its tables are not"});
  writer_of(dir / "vacuumed");
  execute_sql(dir / "vacuumed", "PRAGMA auto_vacuum = FULL; VACUUM");
  refused(dir / "vacuumed", {"vacuumed: this map is corrupt: it has auto_vacuum"});
  writer_of(dir / "counts");
  execute_sql(dir / "counts", "DELETE FROM counts");
  expect_error<InputError>([&] { read_all(*open_map(dir / "counts", MapAccess::kRead)); },
                           {"counts: this map is corrupt: the number of its places is missing"});
}

TEST(MapStore, WhatIsBesideAMapHasToBeAFileOfTheMap) {
  const TempDir dir;
  writer_of(dir / "map")->add(made_places(1, 3));
  const auto refused = [&](const std::string& name) {
    for (const MapAccess access : {MapAccess::kRead, MapAccess::kWrite})
      expect_error<InputError>([&] { open_map(dir / "map", access); }, {name, "move it away"});
    expect_error<InputError>([&] { check_map(dir / "map"); }, {name, "move it away"});
    fs::remove(dir / name);
  };
  for (const char* ending : {"-wal", "-shm", "-journal"}) {
    const std::string name = std::string("map") + ending;
    ASSERT_EQ(::mkfifo((dir / name).c_str(), 0600), 0);
    refused(name);
    fs::create_directory(dir / name);
    refused(name);
    fs::create_symlink("map", dir / name);
    refused(name);
  }
  test::write_file(dir / "map-journal", "of another program");
  refused("map-journal");
  expect_places(*writer_of(dir / "map"), 3);
  // A log without its map.
  test::write_file(dir / "new-wal", "of another program");
  expect_error<InputError>([&] { writer_of(dir / "new"); }, {"new-wal", "move it away"});
  EXPECT_FALSE(fs::exists(dir / "new"));
  EXPECT_EQ(test::read_file(dir / "new-wal"), "of another program");
}

/// A killed program leaves a log for the next process that opens the database, here a copy.
TEST(MapStore, WhatAStrangersProgramLeftIsNotTouched) {
  for (const char* mode : {"DELETE", "WAL"}) {
    SCOPED_TRACE(mode);
    const TempDir dir;
    fs::create_directory(dir / "copy");
    EXPECT_TRUE(in_another_process([&] {
      sqlite::Connection theirs(dir / "db", SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, "db");
      theirs.execute(std::string("PRAGMA journal_mode = ") + mode);
      theirs.execute("PRAGMA cache_size = 1");  // forces writes before the end of a transaction
      theirs.execute("CREATE TABLE t (x)");
      theirs.execute("INSERT INTO t VALUES (zeroblob(100000))");
      theirs.execute("BEGIN");
      theirs.execute("UPDATE t SET x = randomblob(200000)");
      fs::copy(dir.path(), dir / "copy");
      return true;
    }));
    std::map<std::string, std::string> files;
    for (const auto& entry : fs::directory_iterator(dir / "copy"))
      files[entry.path().filename()] = test::read_file(entry.path());
    ASSERT_GE(files.size(), 2);
    const fs::path file = dir / "copy/db";
    EXPECT_THROW(open_map(file, MapAccess::kRead), InputError);
    EXPECT_THROW(open_map(file, MapAccess::kWrite), InputError);
    EXPECT_THROW(writer_of(file), InputError);
    EXPECT_THROW(open_map(file, MapAccess::kNew, &kIdentity), InputError);
    for (const auto& entry : fs::directory_iterator(dir / "copy")) {
      EXPECT_EQ(files[entry.path().filename()], test::read_file(entry.path())) << entry.path();
      files.erase(entry.path().filename());
    }
    EXPECT_TRUE(files.empty());
  }
}

TEST(MapStore, ACutFileIsRefusedOrNamed) {
  const TempDir dir;
  writer_of(dir / "map")->add(made_places(1, 100));
  const std::string whole = test::read_file(dir / "map");
  for (size_t size = 1; size < whole.size(); size += 3001) {
    test::write_file(dir / "cut", whole.substr(0, size));
    EXPECT_FALSE(check_map(dir / "cut").empty()) << size;
    try {
      EXPECT_FALSE(read_all(*open_map(dir / "cut", MapAccess::kRead)).damages.empty()) << size;
    } catch (const InputError&) {
    }
  }
}

/// Reports each acknowledged id until it is killed.
void add_for_ever(const fs::path& file, int pipe) {
  const auto map = writer_of(file);
  int64_t id = map->size();
  while (true) {
    ++id;
    if (id % 7 == 0) map->set_value("threshold", std::to_string(id));
    const StoredPlace place = made(id);
    const int64_t given = map->add({&place, 1}).at(0);
    if (given != id || ::write(pipe, &given, sizeof(given)) != sizeof(given)) break;
  }
}

TEST(MapStore, AKillLosesNothingThatWasAcknowledged) {
  const TempDir dir;
  fs::path file;
  std::mt19937 random(3);
  int64_t acknowledged = 0;
  for (int kill = 0; kill < 250; ++kill) {
    if (kill % 25 == 0) {  // a kill may also happen while the map is created
      file = dir / ("map" + std::to_string(kill));
      acknowledged = 0;
    }
    // Three of four kills soon after an acknowledgment, the others at any time.
    const auto answers = static_cast<int>(random() % 4), wait = static_cast<int>(random() % 4000);
    acknowledged = test::last_before_kill([&](int pipe) { add_for_ever(file, pipe); }, answers,
                                          wait, acknowledged);
    ASSERT_FALSE(HasFailure());

    if (acknowledged > 0 && kill % 2 == 0) {
      ASSERT_EQ(check_map(file), std::vector<std::string>()) << kill;
    }
    const auto map = kill % 3 == 0 && acknowledged > 0
                         ? open_map(file, MapAccess::kRead, &kIdentity)
                         : writer_of(file);
    ASSERT_GE(map->size(), acknowledged) << kill;
    ASSERT_LE(map->size(), acknowledged + 1) << kill;
    expect_places(*map, map->size());
    acknowledged = map->size();
  }
  EXPECT_GT(acknowledged, 0);
}

/// Sets descriptors to the revision and reports each acknowledged one, until it is killed.
void replace_for_ever(const fs::path& file, int pipe) {
  const auto map = writer_of(file);
  for (int64_t revision = read_all(*map).position.revision;; ++revision) {
    const int64_t next = revision + 1;
    const auto number = [next](const StoredPlace&) {
      return std::vector<float>{static_cast<float>(next)};
    };
    if (!map->replace_descriptors(number, {{"basis", std::to_string(next)}}, revision) ||
        ::write(pipe, &next, sizeof(next)) != sizeof(next))
      break;
  }
}

TEST(MapStore, AKillLeavesTheDescriptorsOfOneRevision) {
  const TempDir dir;
  writer_of(dir / "map")->add(made_places(1, 60));
  std::mt19937 random(5);
  int64_t acknowledged = 0;
  for (int kill = 0; kill < 60; ++kill) {
    const auto wait = static_cast<int>(random() % 8000);
    acknowledged = test::last_before_kill([&](int pipe) { replace_for_ever(dir / "map", pipe); },
                                          kill % 4 != 0 ? 1 : 0, wait, acknowledged);
    ASSERT_FALSE(HasFailure());

    const auto map = writer_of(dir / "map");
    const WhatWasRead read = read_all(*map);
    ASSERT_EQ(read.damages, std::vector<std::string>());
    ASSERT_EQ(read.places.size(), 60);
    const int64_t now = read.position.revision;
    ASSERT_GE(now, acknowledged);
    ASSERT_LE(now, acknowledged + 1);
    if (now == 0) continue;
    ASSERT_EQ(map->value("basis"), std::to_string(now));
    for (const StoredPlace& place : read.places)
      ASSERT_EQ(place.descriptor, std::vector<float>{static_cast<float>(now)}) << place.id;
    acknowledged = now;
  }
  EXPECT_GT(acknowledged, 5);
}

TEST(MapStore, ADamagedLogIsRefusedWhenStepsAreBehindTheDamage) {
  const TempDir dir;
  const fs::path file = dir / "map", log = dir / "map-wal";
  ASSERT_TRUE(in_another_process([&] {
    auto map = writer_of(file);
    for (int64_t step = 0; step < 8; ++step) map->add(made_places(3 * step + 1, 3 * step + 3));
    map.release();  // closing it would move the transactions to the file
    return true;
  }));
  const std::string whole = test::read_file(file), sound = test::read_file(log);
  EXPECT_EQ(check_map(file), std::vector<std::string>());
  for (size_t at = 0; at < sound.size(); at += 101) {
    test::write_file(file, whole);
    fs::remove(file.string() + "-shm");
    std::string damaged = sound;
    damaged[at] ^= 0x10;
    test::write_file(log, damaged);
    try {
      EXPECT_GE(open_map(file, MapAccess::kRead)->size(), 24 - 2 * 3) << at;
      EXPECT_GE(writer_of(file)->size(), 24 - 2 * 3) << at;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("map-wal: corrupt at byte"), std::string::npos);
      EXPECT_EQ(check_map(file).size(), 1) << at;
    }
  }
  // State after a power failure: complete transactions and a partial one.
  test::write_file(file, whole);
  test::write_file(log, sound.substr(0, sound.size() - 100));
  EXPECT_EQ(writer_of(file)->size(), 24 - 3);
}

TEST(MapStore, ADamagedByteIsAnErrorOrNamed) {
  const TempDir dir;
  constexpr int64_t kPlaces = 60;
  {
    const auto map = writer_of(dir / "map");
    map->set_value("threshold", "0.5");
    map->add(made_places(1, kPlaces));
    map->remove(std::vector<int64_t>{2, 5, 50});
  }
  const std::string whole = test::read_file(dir / "map");
  std::mt19937 random(5);
  int refused = 0, named = 0;
  for (int flip = 0; flip < 500; ++flip) {
    std::string bytes = whole;
    // Every second one near the beginning of a page, where the B-tree headers are.
    size_t at = random() % bytes.size();
    if (flip % 2 == 0) at = std::min(bytes.size() - 1, at / 4096 * 4096 + random() % 120);
    const char old = bytes[at];
    while (bytes[at] == old) bytes[at] = static_cast<char>(random());
    test::write_file(dir / "copy", bytes);
    SCOPED_TRACE(str("byte ", at, " to ", int{static_cast<unsigned char>(bytes[at])}));
    try {
      const auto map = open_map(dir / "copy", MapAccess::kRead, &kIdentity);
      const WhatWasRead read = read_all(*map);
      for (const StoredPlace& place : read.places) {
        EXPECT_TRUE(same(place, made(place.id)));
        EXPECT_FALSE(place.id == 2 || place.id == 5 || place.id == 50) << "it came back";
      }
      EXPECT_TRUE(read.places.size() == kPlaces - 3 || !read.damages.empty());
      named += read.damages.empty() ? 0 : 1;
      EXPECT_EQ(map->value("threshold"), "0.5");
      EXPECT_TRUE(map->removed() == std::vector<int64_t>({2, 5, 50}) || !read.damages.empty());
    } catch (const InputError& error) {
      EXPECT_HAS(std::string(error.what()), "copy: ");
      EXPECT_FALSE(check_map(dir / "copy").empty()) << error.what();
      ++refused;
    }
  }
  EXPECT_GT(refused, 20);
  EXPECT_GT(named, 50);
}

TEST(MapStore, LostPlacesAndDamagedOnesAreSaid) {
  const TempDir dir;
  writer_of(dir / "map")->add(made_places(1, 9));
  execute_sql(dir / "map",
              "DELETE FROM place WHERE id IN (2, 3);"
              "UPDATE place SET frame = 0 WHERE id = 6");
  const std::vector<std::string> wrong = check_map(dir / "map");
  ASSERT_EQ(wrong.size(), 2);
  EXPECT_HAS(wrong[0], "map: place 6 is corrupt: its checksum is wrong");
  EXPECT_HAS(wrong[1], "map: it has 7 places after place 0, expected 9; restore a copy");
  const auto map = writer_of(dir / "map");
  EXPECT_EQ(read_all(*map, 3).damages.size(), 1);
  EXPECT_EQ(read_all(*map, 6).damages.size(), 0);
  EXPECT_EQ(map->remove(std::vector<int64_t>{2, 3, 6}), 3);
  EXPECT_EQ(check_map(dir / "map"), std::vector<std::string>());
}

TEST(MapStore, DamagedValuesAreErrors) {
  const TempDir dir;
  {
    const auto map = writer_of(dir / "map");
    map->set_value("basis", "b");
    map->set_value("threshold", "0.5");
  }
  const std::string whole = test::read_file(dir / "map");
  for (const char* damage :
       {"UPDATE value SET name = 'bases' WHERE id = 1", "DELETE FROM value WHERE id = 1"}) {
    test::write_file(dir / "map", whole);
    execute_sql(dir / "map", damage);
    const auto map = writer_of(dir / "map");
    expect_error<InputError>([&] { map->value("basis"); }, {"map: this map is corrupt", "value"});
    expect_error<InputError>([&] { map->set_value("basis", ""); }, {"map: this map is corrupt"});
    EXPECT_EQ(check_map(dir / "map").size(), 1);
  }
}

TEST(MapStore, ADamagedHeadIsAnError) {
  const TempDir dir;
  writer_of(dir / "map")->add(made_places(1, 2));
  execute_sql(dir / "map", "UPDATE map SET revision = 1");
  expect_error<InputError>([&] { open_map(dir / "map", MapAccess::kRead); },
                           {"map: this map is corrupt: the checksum of its header is wrong"});
}

/// Other checksums would make existing maps unreadable.
TEST(MapStore, ChecksumsAreTheSameForEver) {
  const TempDir dir;
  const StoredPlace bare{.drive = "00", .frame = 3, .descriptor = {1, 2}};
  StoredPlace whole = bare;
  whole.time = 1.5;
  whole.pose = Eigen::Isometry3d::Identity();
  whole.feature = {4};
  writer_of(dir / "map")->add(std::vector<StoredPlace>{bare, whole});
  execute_sql(dir / "map",
              "UPDATE place SET checksum = -8513214115871854599 WHERE id = 1;"
              "UPDATE place SET checksum = 776762402370247915 WHERE id = 2");
  EXPECT_EQ(check_map(dir / "map"), std::vector<std::string>());
}

/// A full disk or a kill interrupts SQLite's checkpoint after the header was written, but before
/// some of the pages it refers to. The log has them.
TEST(MapStore, AHalfCheckpointIsNoDamage) {
  const TempDir dir;
  uintmax_t bytes = 0;
  {
    const auto map = writer_of(dir / "map");
    map->add(made_places(1, 9));
    bytes = fs::file_size(dir / "map");
    fs::copy(dir / "map-wal", dir / "half-wal");
  }
  ASSERT_GT(fs::file_size(dir / "map"), bytes);
  fs::copy(dir / "map", dir / "half");
  fs::resize_file(dir / "half", bytes);
  EXPECT_EQ(check_map(dir / "half"), std::vector<std::string>());
  expect_places(*writer_of(dir / "half"), 9);
  EXPECT_EQ(fs::file_size(dir / "half"), fs::file_size(dir / "map"));
}

TEST(MapStore, MergedMapsAreOfOneBasis) {
  const TempDir dir;
  std::vector<fs::path> files;
  for (const char* name : {"a", "b", "c"}) {
    files.push_back(dir / name);
    const auto map = writer_of(files.back());
    map->add(*name == 'b' ? made_places(3, 4) : made_places(1, 2));
    map->set_value(kProjectionValue, *name == 'c' ? "another" : "one");
  }
  const auto nothing = [](const std::string&) {};
  expect_error<InputError>([&] { merge_maps(files, dir / "merged", nothing); },
                           {"c: its places", "than those of " + files[0].string() + ";"});
  EXPECT_FALSE(fs::exists(dir / "merged"));
  files.pop_back();
  EXPECT_EQ(merge_maps(files, dir / "merged", nothing), 4);
  EXPECT_EQ(open_map(dir / "merged", MapAccess::kRead)->value(kProjectionValue), "one");
}

TEST(MapStore, PlacesMayHaveClouds) {
  const TempDir dir;
  const auto with_cloud = [](int64_t id, const std::string& cloud) {
    StoredPlace place = made(id);
    place.cloud = cloud;
    return place;
  };
  const std::string large(300'000, 'x');
  {
    const auto map = writer_of(dir / "map");
    map->add(made_places(1, 2));
    EXPECT_EQ(map->cloud(1), "");
    map->add(std::vector{with_cloud(3, "three"), made(4), with_cloud(5, large)});
    EXPECT_EQ(map->cloud(2), "");
    EXPECT_EQ(map->cloud(3), "three");
    EXPECT_EQ(map->cloud(5), large);
    expect_places(*map, 5);
    map->remove(std::vector<int64_t>{3});
    EXPECT_EQ(map->cloud(3), "");
  }
  EXPECT_EQ(check_map(dir / "map"), std::vector<std::string>());
  merge_maps(std::vector<fs::path>{dir / "map"}, dir / "merged", [](auto&&) {});
  EXPECT_EQ(open_map(dir / "merged", MapAccess::kRead)->cloud(4), large);
  execute_sql(dir / "map", "UPDATE cloud SET bytes = 'other' WHERE id = 5");
  expect_error<InputError>([&] { open_map(dir / "map", MapAccess::kRead)->cloud(5); },
                           {"the points of place 5"});
  EXPECT_EQ(check_map(dir / "map").size(), 1);
}

TEST(MapStore, MergedMapsOfBothFormatsHaveScansOnce) {
  const TempDir dir;
  const std::vector<fs::path> files = {dir / "32.map", dir / "16.map"};
  for (const DescriptorType format : {DescriptorType::kFloat32, DescriptorType::kFloat16})
    open_map(files[format == DescriptorType::kFloat16], MapAccess::kNew, &kIdentity, format)
        ->add(
            std::vector{StoredPlace{.drive = "one", .frame = 3, .descriptor = {0.1F, -1.0F / 3}}});
  EXPECT_EQ(merge_maps(files, dir / "merged", [](auto&&) {}), 1);
}

TEST(MapStore, MergedMapsKeepRecordingsApartAndScansOnce) {
  const TempDir dir;
  const std::vector<fs::path> files = {dir / "a.map", dir / "b.map"};
  const auto place = [](const std::string& drive, int64_t frame, float number) {
    return StoredPlace{.drive = drive, .frame = frame, .descriptor = {number}};
  };
  for (int map = 0; map < 2; ++map) {
    const auto number = static_cast<float>(map);
    const auto store = writer_of(files[map]);
    store->add(std::vector{place("base", 7, 5), place("00", 7, number), place("", 7, number)});
    store->set_value(kThresholdValue, "0.5");
    store->set_value(kCalibrationValue, map == 0 ? "one" : "another");
  }
  std::vector<std::string> said;
  const auto tell = [&](const std::string& message) { said.push_back(message); };
  EXPECT_EQ(merge_maps(files, dir / "merged", tell), 5);
  const auto merged = open_map(dir / "merged", MapAccess::kRead);
  std::vector<std::string> drives;
  for (const StoredPlace& stored : read_all(*merged).places) drives.push_back(stored.drive);
  EXPECT_EQ(drives, (std::vector<std::string>{"base", "00", "", "b/00", "b"}));
  EXPECT_EQ(merged->value(kThresholdValue), "0.5");
  EXPECT_EQ(merged->value(kCalibrationValue), std::nullopt);
  ASSERT_EQ(said.size(), 4);
  EXPECT_NE(said[1].find("drive '00' becomes 'b/00'"), std::string::npos) << said[1];
  EXPECT_NE(said[2].find("differ in their calibration"), std::string::npos) << said[2];
  EXPECT_NE(said[3].find("b.map: 1 of its places"), std::string::npos) << said[3];
  // b.map has grown, and another robot has a map of its name.
  fs::create_directory(dir / "robot");
  writer_of(files[1])->add(std::vector{place("00", 8, 1)});
  writer_of(dir / "robot/b.map")->add(std::vector{place("00", 7, 3), place("00", 8, 3)});
  const std::vector<fs::path> more = {dir / "merged", files[1], dir / "robot/b.map"};
  EXPECT_EQ(merge_maps(more, dir / "more", tell), 8);
  std::map<std::string, int> count;
  for (const StoredPlace& stored : read_all(*open_map(dir / "more", MapAccess::kRead)).places)
    ++count[stored.drive];
  EXPECT_EQ(count, (std::map<std::string, int>{
                       {"", 1}, {"00", 1}, {"b", 1}, {"b/00", 2}, {"b/00-2", 2}, {"base", 1}}));
  // A recording with a common beginning is another one, without the common scan.
  writer_of(dir / "alike.map")->add(std::vector{place("b/00-2", 7, 3), place("b/00-2", 8, 4)});
  EXPECT_EQ(merge_maps(std::vector{dir / "more", dir / "alike.map"}, dir / "all", tell), 9);
  EXPECT_EQ(read_all(*open_map(dir / "all", MapAccess::kRead)).places.back().drive, "alike/b/00-2");
  fs::create_symlink(files[0], dir / "again");
  expect_error<UsageError>(
      [&] {
        merge_maps(std::vector<fs::path>{files[0], dir / "again"}, dir / "none", tell);
      },
      {"again is given twice"});
  EXPECT_FALSE(fs::exists(dir / "none"));
}

TEST(MapStore, WhatAStrangersRowCannotBeIsDamage) {
  const auto damage_of = [](const std::function<void(StoredPlace&)>& spoil) {
    StoredPlace place = made(10), read;  // all members are set
    spoil(place);
    PlaceRow bytes;
    bytes.pose.resize(12 * sizeof(double));
    const Eigen::Matrix<double, 3, 4, Eigen::RowMajor> pose = place.pose->matrix().topRows<3>();
    std::memcpy(bytes.pose.data(), pose.data(), bytes.pose.size());
    const auto bytes_of = [](const std::vector<float>& numbers) {
      return std::string(reinterpret_cast<const char*>(numbers.data()), 4 * numbers.size());
    };
    bytes.descriptor = bytes_of(place.descriptor);
    bytes.feature = bytes_of(place.feature);
    RowView row = view_of(place, bytes, 0);
    row.checksum = checksum_of(10, row);
    return take_row(10, row, DescriptorType::kFloat32, 0, read);
  };
  EXPECT_EQ(damage_of([](StoredPlace&) {}), "");
  for (const auto& spoil : std::vector<std::function<void(StoredPlace&)>>{
           [](StoredPlace& p) { p.descriptor[7] = NAN; },
           [](StoredPlace& p) { p.feature[1] = NAN; }, [](StoredPlace& p) { p.time = -INFINITY; },
           [](StoredPlace& p) { p.pose->translation().x() = INFINITY; }})
    EXPECT_EQ(damage_of(spoil), "it has numbers that are not finite");
  EXPECT_EQ(damage_of([](StoredPlace& p) { p.drive += '\0'; }),
            "the name of its drive has a zero byte");
}

TEST(MapStore, MergingTakesAnyNumberOfPlaces) {
  const TempDir dir;
  std::vector<StoredPlace> places(1005);  // more than one transaction takes
  for (size_t i = 0; i < places.size(); ++i) places[i].frame = static_cast<int64_t>(i);
  writer_of(dir / "map")->add(places);
  EXPECT_EQ(merge_maps(std::vector<fs::path>{dir / "map"}, dir / "merged", [](auto&&) {}), 1005);
  EXPECT_EQ(read_all(*open_map(dir / "merged", MapAccess::kRead)).places.back().frame, 1004);
}

TEST(MapStore, OnlyANewMapTakesOverABasis) {
  const TempDir dir;
  const auto map_with = [&](const char* name, const char* basis, int64_t places) {
    auto map = writer_of(dir / name);
    map->add(made_places(1, places));
    if (*basis != '\0') map->set_value(kProjectionValue, basis);
    return map;
  };
  map_with("one", "1", 2);
  const auto refused = [&](MapStore& map) {
    expect_error<InputError>([&] { copy_projection(map, dir / "one", [](auto&&) {}); },
                             {"not described with the descriptor projection of", "one"});
  };
  refused(*map_with("places", "", 1));
  refused(*map_with("basis", "2", 0));
  const auto map = writer_of(dir / "new");
  copy_projection(*map, dir / "one", [](auto&&) {});
  EXPECT_EQ(map->value(kProjectionValue), "1");
  EXPECT_EQ(read_all(*map).position.revision, 1);
  map->add(made_places(1, 1));
  copy_projection(*map, dir / "one", [](auto&&) {});  // no effect: it has this projection
  expect_error<InputError>([&] { copy_projection(*map, dir / "places", [](auto&&) {}); },
                           {"places: its warm-up is not complete: it has 1 places"});
}

TEST(MapStore, ReadInAFolderThatCannotBeWritten) {
  const TempDir dir;
  fs::create_directory(dir / "media");
  const fs::path file = dir / "media/map";
  writer_of(file)->add(made_places(1, 9));
  fs::permissions(dir.path(), fs::perms(0755));
  fs::permissions(file, fs::perms(0444));
  fs::permissions(dir / "media", fs::perms(0555));
  const auto as_nobody = [&](const std::function<bool()>& work) {
    return in_another_process([&] {
      if (::geteuid() == 0 && ::setuid(65534) != 0) return false;
      return work();
    });
  };
  EXPECT_TRUE(as_nobody([&] {
    return read_all(*open_map(file, MapAccess::kRead)).places.size() == 9 &&
           check_map(file).empty();
  }));
  EXPECT_TRUE(as_nobody([&] {
    try {
      writer_of(file);
    } catch (const InputError&) {
      return false;
    } catch (const Error& error) {
      return std::string(error.what()).find("map: cannot be written") != std::string::npos;
    }
    return false;
  }));
  // A copy with its log on read-only media: entries that cannot be read are reported.
  fs::permissions(dir / "media", fs::perms(0755));
  test::write_file(file.string() + "-wal", "something");
  fs::permissions(dir / "media", fs::perms(0555));
  EXPECT_TRUE(as_nobody([&] {
    try {
      open_map(file, MapAccess::kRead);
    } catch (const Error& error) {
      return std::string(error.what()).find("map-wal: its places cannot be read") !=
             std::string::npos;
    }
    return false;
  }));
  fs::permissions(dir / "media", fs::perms(0755));
}

TEST(MapStore, AFullDiskIsAnErrorAndTheMapStaysSound) {
  const TempDir dir;
  writer_of(dir / "map")->add(made_places(1, 10));
  EXPECT_TRUE(in_another_process([&] {
    ::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{200'000, RLIM_INFINITY};
    if (::setrlimit(RLIMIT_FSIZE, &limit) != 0) return false;
    const auto map = writer_of(dir / "map");
    try {
      for (int64_t id = 11; id < 10'000; ++id) map->add(made_places(id, id));
    } catch (const InputError&) {
      return false;
    } catch (const Error& error) {
      const bool named = std::string(error.what()).find("map: cannot be") != std::string::npos;
      const int64_t size = map->size();
      return named && size >= 11 && read_all(*map).places.size() == static_cast<size_t>(size);
    }
    return false;
  }));
  EXPECT_EQ(check_map(dir / "map"), std::vector<std::string>());
  const auto map = writer_of(dir / "map");
  const int64_t size = map->size();
  EXPECT_GE(size, 11);
  map->add(made_places(size + 1, size + 5));
  expect_places(*map, size + 5);
}

}  // namespace
}  // namespace revisit
