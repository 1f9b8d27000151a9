#include "revisit/maps/map_store.h"

#include <sys/mman.h>

#include "execute_sql.h"
#include "map_entries.h"
#include "map_format.h"
#include "postgres_server.h"
#include "process.h"
#include "testing.h"

namespace revisit {
namespace {

const auto kIgnore = [](const std::string&) {};

/// Operations of MapStore, for a map in a file ("file") and on a server ("server").
class MapStoreTest : public ::testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    if (!is_server()) return;
    if (const std::string why = PostgresServer::missing(); !why.empty()) GTEST_SKIP() << why;
    server_ = &PostgresServer::without_maps();
  }
  static bool is_server() { return GetParam() == "server"; }

  fs::path at(const std::string& map = "town") const {
    return is_server() ? fs::path(server_->url(map)) : folder_ / map;
  }
  std::unique_ptr<MapStore> map_with(const std::string& name, const std::string& projection,
                                     int64_t first, int64_t last) const {
    auto map = writer_of(at(name));
    map->add(made_entries(first, last));
    if (!projection.empty()) map->set_value(kProjectionValue, projection);
    return map;
  }
  void execute(const std::string& map, const std::string& sql) const {
    if (is_server())
      server_->execute(str("SET search_path = \"", map, "\"; ", sql));
    else
      execute_sql(at(map), sql);
  }
  TempDir folder_;
  PostgresServer* server_ = nullptr;
};
INSTANTIATE_TEST_SUITE_P(Databases, MapStoreTest, ::testing::Values("file", "server"),
                         [](const auto& one) { return one.param; });

TEST_P(MapStoreTest, KeepsEntriesAndValues) {
  for (const auto& [name, format] : {std::pair("town", DescriptorType::kFloat32),
                                     std::pair("both", DescriptorType::kFloat16)}) {  // a keyword
    {
      const auto map = writer_of(at(name), format);
      EXPECT_EQ(map->size(), 0);
      EXPECT_EQ(map->dimensions(), std::nullopt);
      std::vector<int64_t> ids(280);
      std::iota(ids.begin(), ids.end(), 1);
      EXPECT_EQ(map->add(made_entries(1, 280)), ids);
      EXPECT_EQ(map->add({}), std::vector<int64_t>());
      EXPECT_EQ(map->add(made_entries(281, 281)), std::vector<int64_t>{281});
      map->set_value("long", std::string(20'000, '\1'));
      map->set_value("bytes", "0.5");
      map->set_value("bytes", std::string("0.\0", 3));
    }
    EXPECT_EQ(check_map(at(name)), std::vector<std::string>());
    for (const MapAccess access : {MapAccess::kRead, MapAccess::kWrite}) {
      const auto map = open_map(at(name), access);
      expect_entries(*map, 281);
      EXPECT_EQ(map->fingerprint(), kFingerprint);
      EXPECT_EQ(map->descriptor_type(), format);
      EXPECT_EQ(map->dimensions(), 100);
      EXPECT_EQ(map->value("long"), std::string(20'000, '\1'));
      EXPECT_EQ(map->value("bytes"), std::string("0.\0", 3));
      EXPECT_EQ(map->value("none"), std::nullopt);
      EXPECT_EQ(map->cloud(21), "points of 21");
      EXPECT_EQ(map->cloud(22), "");
      EXPECT_EQ(read_all(*map, 278).entries.size(), 3);
    }
  }
}

TEST_P(MapStoreTest, Float16RoundsWithinItsBound) {
  const auto map = writer_of(at("town"), DescriptorType::kFloat16);
  MapEntry entry;
  for (float x = 1e-9F; x < 65'500; x *= 1.003F) entry.descriptor.push_back(x);
  map->add({&entry, 1});
  const std::vector<float> kept = read_all(*map).entries[0].descriptor;
  for (size_t i = 0; i < kept.size(); ++i)
    ASSERT_LE(std::abs(kept[i] - entry.descriptor[i]),
              std::max(std::ldexp(entry.descriptor[i], -11), std::ldexp(1.0F, -25)));
  entry.descriptor = {65'600.0F};
  expect_error<UsageError>([&] { map->add({&entry, 1}); }, {"65600", "float16"});
}

TEST_P(MapStoreTest, RejectsInvalidEntriesAndChangesByReaders) {
  const auto map = writer_of(at());
  const auto rejected = [&](const std::function<void(MapEntry&)>& change, const char* what) {
    std::vector<MapEntry> entries = made_entries(1, 3);
    change(entries[1]);
    expect_error<UsageError>([&] { map->add(entries); }, {"entry 2", what});
  };
  rejected([](MapEntry& e) { e.descriptor[7] = NAN; }, "its descriptor");
  rejected([](MapEntry& e) { e.feature = {INFINITY}; }, "its feature");
  rejected([](MapEntry& e) { e.time = NAN; }, "its time");
  rejected([](MapEntry& e) { e.pose->translation().x() = NAN; }, "its pose");
  rejected(
      [](MapEntry& e) {
        e.loops = {{.place = 1}, {.place = 2}};
        e.loops[1].information(0, 5) = NAN;
      },
      "its loops");
  rejected([](MapEntry& e) { e.drive = std::string("x\0y", 3); }, "'x' has a zero byte");
  const auto other = reader_of(at());
  for (const auto& change : std::vector<std::function<void()>>{
           [&] { other->add(made_entries(1, 1)); }, [&] { other->set_value("a", ""); },
           [&] { other->replace_descriptors({}, {}, 0); }, [&] { other->remove({}); }})
    expect_error<UsageError>(change, {"for reading"});
  EXPECT_EQ(map->size(), 0);
}

TEST_P(MapStoreTest, RejectsOtherFingerprintsAndVersions) {
  const MapFingerprint odd{{"a=b", "c"}};
  expect_error<UsageError>([&] { open_map(at("odd"), MapAccess::kWrite, &odd); }, {"a=b"});
  expect_error<InputError>([&] { reader_of(at("missing")); }, {"there is no"});
  writer_of(at());
  expect_error<InputError>([&] { open_map(at("town"), MapAccess::kNew, &kFingerprint); },
                           {"already exists"});
  MapFingerprint other = kFingerprint;
  other["weights"] = "sha256 4567";
  other.erase("image");
  other["code"] = "7";
  for (const MapAccess access : {MapAccess::kRead, MapAccess::kWrite}) {
    const std::string message =
        message_of<InputError>([&] { open_map(at("town"), access, &other); });
    EXPECT_HAS(message, "weights: the map has 'sha256 0123', this program 'sha256 4567'");
    EXPECT_HAS(message, "image: the map has '1024x64', this program none");
    EXPECT_HAS(message, "code: the map has none, this program '7'");
    EXPECT_EQ(message.find("feature"), std::string::npos) << message;
  }
  expect_entries(*writer_of(at()), 0);
  execute("town", is_server() ? "UPDATE map SET version = 4" : "PRAGMA user_version = 4");
  for (const MapAccess access : {MapAccess::kRead, MapAccess::kWrite})
    expect_error<InputError>([&] { open_map(at("town"), access); }, {"map version 4 (expected 3)"});
}

/// Nothing of an untrusted map may be executed, or cause endless work.
TEST_P(MapStoreTest, RejectsUntrustedTables) {
  const std::vector<std::string> of_files = {
      "CREATE VIEW v AS SELECT * FROM entry",
      "DROP TABLE counts; CREATE VIEW counts AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT "
      "x+1 FROM c) SELECT x AS id, 1 AS entries, 1 AS \"values\", 0 AS checksum FROM c",
      "CREATE TRIGGER t AFTER INSERT ON entry BEGIN DELETE FROM entry; END",
      "CREATE INDEX i ON entry(abs(frame))",
      "ALTER TABLE entry ADD COLUMN more TEXT",
      "DROP TABLE entry; CREATE TABLE entry (id TEXT, drive TEXT)",
      "PRAGMA writable_schema=1; UPDATE sqlite_schema SET rootpage=2",
      "PRAGMA writable_schema=1; UPDATE sqlite_schema SET rootpage=-5 WHERE name='entry'",
      "PRAGMA writable_schema=1; UPDATE sqlite_schema SET sql=NULL WHERE name='entry'",
      "PRAGMA auto_vacuum = FULL; VACUUM"};
  const std::vector<std::string> of_servers = {
      "UPDATE map SET fingerprint = NULL",
      "ALTER TABLE map ALTER revision TYPE text USING 'x'",
      "ALTER TABLE entry DROP COLUMN time",
      "UPDATE entry SET frame = NULL",
      "ALTER TABLE entry ALTER descriptor TYPE text USING 'x'",
      "DROP TABLE removed",
      "DROP TABLE counts; CREATE VIEW counts AS SELECT 1 AS id, 1::bigint AS entries",
      "UPDATE entry SET id = 1000000000000000 WHERE id = 7; DELETE FROM counts",
      "CREATE FUNCTION f() RETURNS trigger LANGUAGE plpgsql AS 'BEGIN RAISE ''no''; END'; CREATE "
      "TRIGGER t BEFORE INSERT ON entry FOR EACH ROW EXECUTE FUNCTION f()"};
  std::vector<std::string> changes = is_server() ? of_servers : of_files;
  changes.emplace_back("DELETE FROM map; DELETE FROM counts; DELETE FROM entry");
  for (size_t i = 0; i < changes.size(); ++i) {
    SCOPED_TRACE(changes[i]);
    const std::string name = str("map", i);
    writer_of(at(name))->add(made_entries(1, 9));
    execute(name, changes[i]);
    int rejected = 0;
    for (const auto& use : std::vector<std::function<void()>>{
             [&] {
               if (!read_all(*reader_of(at(name))).problems.empty()) throw InputError("corrupt");
             },
             [&] { open_map(at(name), MapAccess::kWrite)->add(made_entries(10, 10)); },
             [&] { open_map(at(name), MapAccess::kWrite)->remove(std::vector<int64_t>{1}); }})
      try {
        use();
      } catch (const Error& error) {
        EXPECT_TRUE(is_server() || dynamic_cast<const InputError*>(&error)) << error.what();
        ++rejected;
      }
    EXPECT_GE(rejected, is_server() ? 1 : 3);
  }
}

TEST_P(MapStoreTest, ReplacesDescriptorsInOneTransaction) {
  const auto map = writer_of(at());
  map->add(made_entries(1, 30));
  const auto other = reader_of(at());
  EXPECT_EQ(read_all(*other).state.revision, 0);
  const auto shorter = [](const MapEntry& entry) {
    EXPECT_TRUE(same(entry, made_entry("x", entry.id)));
    return std::vector<float>{static_cast<float>(entry.id), 0.5F};
  };
  const auto fail_at_20 = [](const MapEntry& entry) {
    if (entry.id == 20) throw std::runtime_error("no");
    return std::vector<float>{};
  };
  EXPECT_THROW(map->replace_descriptors(fail_at_20, {{"a", "b"}}, 0), std::runtime_error);
  expect_entries(*map, 30);
  EXPECT_EQ(map->value("a"), std::nullopt);
  EXPECT_TRUE(map->replace_descriptors(shorter, {{"a", "b"}, {"bytes", "t"}}, 0));
  EXPECT_FALSE(map->replace_descriptors(shorter, {{"a", "c"}}, 0));
  EXPECT_TRUE(map->add(made_entries(31, 31), 0).empty());
  const ReadMap read = read_all(*other);
  EXPECT_EQ(read.state.revision, 1);
  ASSERT_EQ(read.entries.size(), 30);
  for (const MapEntry& entry : read.entries) {
    MapEntry expected = made_entry("x", entry.id);
    expected.descriptor = {static_cast<float>(entry.id), 0.5F};
    expected.feature.clear();
    EXPECT_TRUE(same(entry, expected));
  }
  EXPECT_EQ(other->dimensions(), 2);
  EXPECT_EQ(other->value("a"), "b");
  EXPECT_EQ(other->value("bytes"), "t");
  EXPECT_EQ(map->add(made_entries(31, 31), 1), std::vector<int64_t>{31});
  EXPECT_TRUE(same(read_all(*other, 30).entries.at(0), made_entry("x", 31)));
  EXPECT_EQ(check_map(at()), std::vector<std::string>());
}

TEST_P(MapStoreTest, RemovesEntriesAndNeverReusesTheirIds) {
  {
    const auto map = writer_of(at());
    map->add(made_entries(1, 600));
    const auto other = reader_of(at());
    EXPECT_EQ(map->remove({}), 0);
    EXPECT_EQ(map->remove(std::vector<int64_t>{600, 7, 256, 7}), 3);
    EXPECT_EQ(map->remove(std::vector<int64_t>{7, 4}), 1);
    EXPECT_EQ(map->remove(std::vector<int64_t>{7}), 0);
    for (const int64_t id : {601, 0})
      expect_error<UsageError>(
          [&] {
            map->remove(std::vector<int64_t>{5, id});
          },
          {str("entry ", id), "1 to 600"});
    for (const MapStore* one : {&*map, &*other}) {
      expect_entries(*one, 600, {4, 7, 256, 600});
      EXPECT_EQ(one->removed(), (std::vector<int64_t>{7, 256, 600, 4}));
      EXPECT_EQ(one->removed(3), std::vector<int64_t>{4});
      EXPECT_EQ(one->cloud(7), "");
    }
    EXPECT_EQ(map->add(made_entries(601, 602)), (std::vector<int64_t>{601, 602}));
    EXPECT_FALSE(map->has_updates()) << "its own changes";
    EXPECT_TRUE(has_updates_soon(*other));
    // Removed entries are not described again for a new projection.
    EXPECT_TRUE(map->replace_descriptors([](const MapEntry& entry) { return entry.descriptor; },
                                         {{kProjectionValue, "p"}}, 0));
    EXPECT_EQ(read_all(*other).entries.size(), 598);
  }
  EXPECT_EQ(check_map(at()), std::vector<std::string>());
  EXPECT_EQ(merge_maps(std::vector{at("town")}, at("merged"), kIgnore), 598);
  EXPECT_EQ(check_map(at("merged")), std::vector<std::string>());
  EXPECT_TRUE(reader_of(at("merged"))->removed().empty());
  // 4 and 7 are removed, so ids after them are 2 lower.
  const std::vector<MapEntry> merged = read_all(*reader_of(at("merged"))).entries;
  EXPECT_TRUE(merged.at(9).loops.empty()) << "to entry 7";
  EXPECT_EQ(merged.at(15).loops.at(1).place, 13 - 2);
  EXPECT_EQ(merged.at(15).questioned, (std::vector<int64_t>{10 - 2, 13 - 2}));
  EXPECT_EQ(reader_of(at("merged"))->value(kProjectionValue), "p");
}

/// Corrupt numbers must not cause endless work either.
TEST_P(MapStoreTest, ReportsCorruptAndLostRows) {
  const auto list = [](int64_t id, int64_t entry) {
    return str("INSERT INTO removed VALUES (", id, ",", entry, ",",
               Checksum().number(id).number(entry).value(), ")");
  };
  const auto count = [](int64_t n, int64_t values) {
    return str("UPDATE counts SET entries = ", n,
               ", checksum = ", Checksum().number(n).number(values).value());
  };
  const std::vector<std::pair<std::string, std::string>> changes = {
      {"UPDATE entry SET frame = 0 WHERE id = 270", "entry 270 is corrupt: its checksum is wrong"},
      {"DELETE FROM entry WHERE id IN (7, 270)", "has 296 entries after entry 0, expected 298"},
      {"UPDATE cloud SET bytes = 'other' WHERE id = 7", "the points of entry 7"},
      {list(3, 5), "has 298 entries after entry 0, expected 297"},  // an existing entry
      {list(INT64_MAX, 5), "has 298 entries after entry 0, expected 297"},
      {"DELETE FROM removed WHERE entry = 2", "has 298 entries after entry 0, expected 299"},
      {"UPDATE removed SET entry = 4 WHERE id = 1", "the checksum of a removed entry is wrong"},
      {count(-1, 2), "cannot have -1 entries"},
      {count(INT64_MAX, 2), "cannot have 9223372036854775807 entries"},
      {count(INT64_MAX, 0), "the checksum of the number of its entries is wrong"},
      {"DELETE FROM counts", "the number of its entries is missing"},
      {"UPDATE value SET bytes = 'c' WHERE name = 'projection'",
       "the checksum of a value is wrong"},
      {"DELETE FROM value WHERE name = 'projection'", "it has 1 values beside its entries"},
      {"UPDATE map SET revision = 1", "the checksum of its header is wrong"}};
  for (size_t i = 0; i < changes.size(); ++i) {
    const auto& [change, problem] = changes[i];
    SCOPED_TRACE(change);
    const std::string name = str("map", i);
    {
      const auto map = writer_of(at(name));
      map->add(made_entries(1, 300));
      map->remove(std::vector<int64_t>{2, 3});
      map->set_value(kProjectionValue, "b");
      map->set_value("another", "0.5");
    }
    execute(name, change);
    const std::vector<std::string> problems = check_map(at(name));
    ASSERT_EQ(problems.size(), 1);
    EXPECT_HAS(problems[0], problem);
    if (i < 3) {  // corrupt entries can be removed
      const auto map = writer_of(at(name));
      EXPECT_EQ(read_all(*map, 270).problems.size(), 0);
      EXPECT_EQ(map->remove(std::vector<int64_t>{2, 7, 270}), 2);
      EXPECT_EQ(check_map(at(name)), std::vector<std::string>());
    } else if (change == list(INT64_MAX, 5)) {  // there is no further id
      EXPECT_THROW(writer_of(at(name))->remove(std::vector<int64_t>{6}), Error);
    } else if (change.find("counts") != std::string::npos) {
      expect_error<InputError>([&] { writer_of(at(name))->add(made_entries(301, 301)); },
                               {"corrupt"});
    } else if (change.find("value") != std::string::npos) {
      expect_error<InputError>([&] { reader_of(at(name))->value(kProjectionValue); }, {"corrupt"});
    }
  }
}

TEST_P(MapStoreTest, MergesMapsOfOneProjectionOnly) {
  map_with("a", "one", 1, 2);
  map_with("b", "one", 3, 7);
  map_with("c", "another", 1, 2);
  const std::vector<fs::path> maps = {at("a"), at("b"), at("c")};
  const std::span both(maps.data(), 2);
  expect_error<InputError>([&] { merge_maps(maps, at("merged"), kIgnore); },
                           {"c", ": its entries have another descriptor projection than those of"});
  EXPECT_THROW(reader_of(at("merged")), InputError);
  map_with("bare", "", 1, 1);
  const std::vector<fs::path> unlike = {at("a"), at("bare")};
  expect_error<InputError>([&] { merge_maps(unlike, at("merged"), kIgnore); },
                           {": its warm-up is not complete, unlike that of"});
  expect_error<InputError>([&] { merge_maps(both, at("a"), kIgnore); }, {"already exists"});
  EXPECT_EQ(merge_maps(both, at("merged"), kIgnore), 7);
  EXPECT_EQ(reader_of(at("merged"))->value(kProjectionValue), "one");
  EXPECT_EQ(reader_of(at("merged"))->cloud(7), "points of 7");
}

TEST_P(MapStoreTest, CopiesProjectionsToNewMapsOnly) {
  map_with("one", "1", 1, 2);
  const auto rejected = [&](MapStore& map) {
    expect_error<InputError>([&] { copy_projection(map, at("one"), kIgnore); },
                             {"not described with the descriptor projection of", "one"});
  };
  rejected(*map_with("filled", "", 1, 1));
  rejected(*map_with("projected", "2", 1, 0));
  const auto map = writer_of(at("empty"));
  copy_projection(*map, at("one"), kIgnore);
  EXPECT_EQ(map->value(kProjectionValue), "1");
  EXPECT_EQ(read_all(*map).state.revision, 1);
  map->add(made_entries(1, 1));
  copy_projection(*map, at("one"), kIgnore);  // no effect: it has this projection
  expect_error<InputError>([&] { copy_projection(*map, at("filled"), kIgnore); },
                           {"filled", ": warm-up not complete; add more scans before merging (found 1 entries)"});
}

/// Frames of a writer's drive that are in the map as soon as the writer knows it.
struct Acknowledged {
  std::atomic<int64_t> first = 1, last = 0;
};

/// Waits for the map, for the end of its writer, or for its server.
std::unique_ptr<MapStore> open_patiently(const fs::path& where, MapAccess access) {
  while (true) try {
      return open_map(where, access, access == MapAccess::kWrite ? &kFingerprint : nullptr);
    } catch (const Error&) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
}

/// Adds frames 1, 2, ... of its drive, removes its first ones and replaces all descriptors by the
/// revision's number, until it is killed.
void write_for_ever(const fs::path& where, const std::string& drive, Acknowledged& acknowledged) {
  const auto map = open_patiently(where, MapAccess::kWrite);
  std::mt19937 random(std::random_device{}());
  while (true) {
    const ReadMap read = read_all(*map);
    const int64_t revision = read.state.revision;
    std::vector<int64_t> ids;
    int64_t last = 0;
    for (const MapEntry& entry : read.entries)
      if (entry.drive == drive) ids.push_back(entry.id), last = entry.frame;
    const auto choice = random() % 8;
    if (choice == 0) {
      const auto set = [&](const MapEntry&) {
        return std::vector{static_cast<float>(revision + 1)};
      };
      map->replace_descriptors(set, {{"revision", str(revision + 1)}}, revision);
    } else if (choice == 1 && ids.size() > 1) {
      ASSERT_EQ(map->remove({ids.data(), 1}), 1);
      acknowledged.first = last + 2 - std::ssize(ids);
    } else {
      std::vector<MapEntry> entries(1 + choice % 2);
      for (MapEntry& entry : entries)
        entry = {.drive = drive, .frame = ++last, .descriptor = {static_cast<float>(revision)}};
      if (!map->add(entries, revision).empty()) acknowledged.last = last;
    }
  }
}

/// Each entry must be passed on in the order of the ids.
void read_for_ever(const fs::path& where) {
  const auto map = open_patiently(where, MapAccess::kRead);
  for (int64_t last = 0;;) {
    const ReadMap read = read_all(*map, last);
    ASSERT_EQ(read.problems, std::vector<std::string>());
    for (const MapEntry& entry : read.entries) {
      ASSERT_GT(entry.id, last);
      last = entry.id;
    }
    last = read.state.last;
  }
}

/// The map must have all acknowledged changes, and one more at most of the killed process.
int64_t check_changes(const MapStore& map, std::span<Acknowledged> acknowledged, size_t killed) {
  std::vector<std::pair<int64_t, int64_t>> at_least;
  for (const Acknowledged& one : acknowledged) at_least.emplace_back(one.first, one.last);
  const ReadMap read = read_all(map);
  EXPECT_EQ(read.problems, std::vector<std::string>());
  std::vector<std::pair<int64_t, int64_t>> found(acknowledged.size(), {1, 0});  // of each drive
  for (const MapEntry& entry : read.entries) {
    auto& [first, last] = found.at(static_cast<size_t>(entry.drive.at(0) - 'a'));
    if (last == 0) first = entry.frame, last = first - 1;
    EXPECT_EQ(entry.frame, ++last) << "lost, or there twice";
    EXPECT_EQ(entry.descriptor, std::vector{static_cast<float>(read.state.revision)});
  }
  int64_t all = 0;
  for (size_t i = 0; i < found.size(); ++i) {
    const auto& [first, last] = found[i];
    all += last;
    EXPECT_GE(first, at_least[i].first);
    EXPECT_GE(last, at_least[i].second);
    if (i != killed) continue;
    EXPECT_LE(first - at_least[i].first + (last - at_least[i].second + 1) / 2, 1);
    acknowledged[i].first = first;
    acknowledged[i].last = last;
  }
  EXPECT_EQ(read.state.last, all) << "an id was lost";
  EXPECT_GE(std::stoll(map.value("revision").value_or("0")), read.state.revision);
  return all;
}

/// Two writers and a reader in three processes. One of them, or the server, is killed and started
/// again many times. REVISIT_TEST_MINUTE=1 kills one per second for a minute.
TEST_P(MapStoreTest, KeepsAcknowledgedChangesOfKilledProcesses) {
  const bool takes_a_minute = std::getenv("REVISIT_TEST_MINUTE") != nullptr;
  const int maps = takes_a_minute ? 1 : 5, kills = takes_a_minute ? 60 : is_server() ? 15 : 50;
  std::mt19937 random(3);
  for (int i = 0; i < maps; ++i) {  // kills also happen while a map is created
    const std::string name = str("map", i);
    void* const shared = ::mmap(nullptr, 2 * sizeof(Acknowledged), PROT_READ | PROT_WRITE,
                                MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    ASSERT_NE(shared, MAP_FAILED);
    const std::span acknowledged(new (shared) Acknowledged[2], 2);
    const auto start = [&](size_t one) {
      return std::make_unique<Process>([&, one] {
        if (one == 2) return read_for_ever(at(name));
        write_for_ever(at(name), one == 0 ? "a" : "b", acknowledged[one]);
      });
    };
    std::array processes = {start(0), start(1), start(2)};
    std::unique_ptr<MapStore> watcher;
    int64_t added = 0, seen = 0;
    for (int kill = 0; kill < kills && !HasFailure(); ++kill) {
      std::this_thread::sleep_for(std::chrono::milliseconds(takes_a_minute ? 1000 : random() % 40));
      const size_t victim = is_server() && kill % 5 == 4 ? 3 : random() % 3;
      if (victim < 3)
        processes[victim]->kill();
      else if (kill % 10 == 9)
        server_->restart();
      else
        server_->close_connections("backend_type = 'client backend'");
      if (is_server()) writer_of(at(name))->remove({});  // waits for a commit of the killed process
      if (is_server() || fs::exists(at(name))) {
        added = check_changes(*reader_of(at(name)), acknowledged, victim);
        if (kill % 8 == 0) {
          EXPECT_EQ(check_map(at(name)), std::vector<std::string>());
        }
        if (!watcher) watcher = reader_of(at(name));
        while (seen < added && has_updates_soon(*watcher)) {
          seen = read_all(*watcher, seen).state.last;
        }
        EXPECT_GE(seen, added) << "a reader that waits for updates misses entries";
      }
      if (victim < 3) processes[victim] = start(victim);
    }
    EXPECT_GT(added, 20);
    std::puts(str(GetParam(), ": ", kills, " kills, ", added, " entries added").c_str());
  }
}

TEST(MergeMaps, KeepsRecordingsApartAndScansOnce) {
  const TempDir dir;
  const std::vector<fs::path> files = {dir / "a.map", dir / "b.map"};
  const auto entry = [](const std::string& drive, int64_t frame, float number) {
    return MapEntry{.drive = drive, .frame = frame, .descriptor = {number}};
  };
  for (int map = 0; map < 2; ++map) {
    const auto store = writer_of(files[map]);
    const auto number = static_cast<float>(map);
    store->add(std::vector{entry("base", 7, 5), entry("00", 7, number)});
    store->set_value(kVerifiedCalibrationValue, "0.5 margin");
    store->set_value(kCalibrationValue, map == 0 ? "one" : "another");
  }
  std::vector<std::string> reports;
  const MapStore::Warn report = into(reports);
  EXPECT_EQ(merge_maps(files, dir / "merged", report), 3);
  const auto merged = reader_of(dir / "merged");
  std::vector<std::string> drives;
  for (const MapEntry& stored : read_all(*merged).entries) drives.push_back(stored.drive);
  EXPECT_EQ(drives, (std::vector<std::string>{"base", "00", "b/00"}));
  EXPECT_EQ(merged->value(kVerifiedCalibrationValue), "0.5 margin");
  EXPECT_EQ(merged->value(kCalibrationValue), std::nullopt);
  ASSERT_EQ(reports.size(), 3);
  EXPECT_HAS(reports[0], "differ in their calibration");
  EXPECT_HAS(reports[1], "drive '00' becomes 'b/00'");
  EXPECT_HAS(reports[2], "b.map: 1 of its entries");
  // b.map has grown, and another robot has a map of its name.
  fs::create_directory(dir / "robot");
  writer_of(files[1])->add(std::vector{entry("00", 8, 1)});
  writer_of(dir / "robot/b.map")->add(std::vector{entry("00", 7, 3), entry("00", 8, 3)});
  EXPECT_EQ(
      merge_maps(std::vector{dir / "merged", files[1], dir / "robot/b.map"}, dir / "more", report),
      6);
  std::map<std::string, int> count;
  for (const MapEntry& stored : read_all(*reader_of(dir / "more")).entries) ++count[stored.drive];
  EXPECT_EQ(count,
            (std::map<std::string, int>{{"00", 1}, {"b/00", 2}, {"b/00-2", 2}, {"base", 1}}));
  // A recording with a common beginning is another one, without the common scan.
  writer_of(dir / "alike.map")->add(std::vector{entry("b/00-2", 7, 3), entry("b/00-2", 8, 4)});
  EXPECT_EQ(merge_maps(std::vector{dir / "more", dir / "alike.map"}, dir / "all", report), 7);
  EXPECT_EQ(read_all(*reader_of(dir / "all")).entries.back().drive, "alike/b/00-2");
  fs::create_symlink(files[0], dir / "again");
  expect_error<UsageError>(
      [&] {
        merge_maps(std::vector{files[0], dir / "again"}, dir / "none", report);
      },
      {"again is given twice"});
  EXPECT_FALSE(fs::exists(dir / "none"));
}

TEST_P(MapStoreTest, MergesAnyNumberOfEntriesOfBothTypes) {
  std::vector<MapEntry> entries(1005);  // more than one transaction takes
  for (size_t i = 0; i < entries.size(); ++i)
    entries[i] = {.frame = static_cast<int64_t>(i), .descriptor = {0.1F, -1.0F / 3}};
  const std::vector<fs::path> maps = {at("float32"), at("float16")};
  for (const DescriptorType format : {DescriptorType::kFloat32, DescriptorType::kFloat16})
    writer_of(at(name_of(format)), format)->add(entries);
  EXPECT_EQ(merge_maps(maps, at("merged"), kIgnore), 1005);
  EXPECT_EQ(read_all(*reader_of(at("merged"))).entries.back().frame, 1004);
}

/// Other checksums would make existing maps unreadable.
TEST(MapFormat, ChecksumsNeverChange) {
  const MapEntry bare{.drive = "00", .frame = 3, .descriptor = {1, 2}};
  MapEntry whole = bare;
  whole.time = 1.5;
  whole.pose = Eigen::Isometry3d::Identity();
  whole.feature = {4};
  const auto checksum = [](int64_t id, const MapEntry& entry) {
    return checksum_of(entry_columns(id, entry, encoded(entry, DescriptorType::kFloat32, 1), 0));
  };
  EXPECT_EQ(checksum(1, bare), 6653914900007652521);
  EXPECT_EQ(checksum(2, whole), -2303595328612501534);
}

TEST(MapFormat, RejectsInvalidRowsWithValidChecksums) {
  struct Row : EntryBytes {
    MapEntry entry = made_entry("x", 10);  // has all columns
    int64_t revision = 0;
  };
  using Change = std::function<void(Row&)>;
  const auto put = [](auto number, std::string EntryBytes::*column) -> Change {
    return [=](Row& row) { std::memcpy((row.*column).data(), &number, sizeof(number)); };
  };
  const std::string not_finite = "it has numbers that are not finite",
                    corrupt = "its feature is corrupt or has other dimensions";
  for (const auto& [change, problem] : std::vector<std::pair<Change, std::string>>{
           {[](Row&) {}, ""},
           {put(float{NAN}, &EntryBytes::descriptor), not_finite},
           {put(double{NAN}, &EntryBytes::pose), not_finite},
           {[](Row& row) { row.entry.time = -INFINITY; }, not_finite},
           {[](Row& row) { row.entry.drive += '\0'; }, "the name of its drive has a zero byte"},
           {[](Row& row) { row.descriptor.pop_back(); }, "its columns have impossible lengths"},
           {put(uint32_t{0xFFFFFFFF}, &EntryBytes::feature), corrupt},
           {put(uint32_t{2}, &EntryBytes::feature), corrupt},
           {put(uint32_t{4}, &EntryBytes::feature), corrupt},
           {[](Row& row) { row.feature.pop_back(); }, corrupt},
           {[](Row& row) { row.feature = "\1"; }, corrupt},
           {[](Row& row) { row.revision = 1; }, "it is older than the map's other descriptors"}}) {
    Row row;
    static_cast<EntryBytes&>(row) = encoded(row.entry, DescriptorType::kFloat32, 1);
    change(row);
    std::vector<SqlValue> cells = entry_columns(10, row.entry, row, row.revision);
    for (SqlValue& cell : cells)
      if (const auto* blob = std::get_if<Blob>(&cell)) cell = std::string_view(blob->bytes);
    cells.emplace_back(checksum_of(cells));
    MapEntry read;
    EXPECT_EQ(read_entry({"map", cells}, {}, read), problem);
  }
}

}  // namespace
}  // namespace revisit
