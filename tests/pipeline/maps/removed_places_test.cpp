#include "removed_places.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <random>
#include <set>

#include "execute_sql.h"
#include "expect_error.h"
#include "killed_writer.h"
#include "read_map.h"
#include "test_data.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;
using test::execute_sql;
using test::expect_error;
using test::TempDir;

const MapFingerprint kOfRemoved{{"feature", "numbers"}};

std::vector<StoredPlace> some_places(int64_t first, int64_t last) {
  std::vector<StoredPlace> places;
  for (int64_t id = first; id <= last; ++id) {
    StoredPlace& place = places.emplace_back();
    place.id = id;
    place.drive = id % 2 == 0 ? "even" : "odd";
    place.frame = id;
    place.descriptor.assign(100, static_cast<float>(id));
    place.feature.assign(id % 3 == 0 ? 2000 : 10, 0.5F);  // some on pages of their own
  }
  return places;
}

std::unique_ptr<MapStore> writer_at(const fs::path& file) {
  return open_map(file, MapAccess::kWrite, &kOfRemoved);
}

void expect_all_but(const MapStore& map, int64_t n, const std::set<int64_t>& removed) {
  const WhatWasRead read = read_all(map);
  EXPECT_EQ(read.damages, std::vector<std::string>());
  std::vector<StoredPlace> wanted = some_places(1, n);
  std::erase_if(wanted, [&](const StoredPlace& place) { return removed.contains(place.id); });
  ASSERT_EQ(read.places.size(), wanted.size());
  for (size_t i = 0; i < wanted.size(); ++i) {
    EXPECT_EQ(read.places[i].id, wanted[i].id);
    EXPECT_TRUE(same(read.places[i], wanted[i])) << wanted[i].id;
  }
  EXPECT_EQ(read.position.last, n);
  EXPECT_EQ(read.position.removed, static_cast<int64_t>(removed.size()));
  EXPECT_EQ(map.size(), n - static_cast<int64_t>(removed.size()));
}

TEST(RemovedPlaces, AreGoneAndTheirIdsAreNotGivenAgain) {
  const TempDir dir;
  const fs::path file = dir / "map";
  {
    const auto map = writer_at(file);
    map->add(some_places(1, 20));
    const auto reader = open_map(file, MapAccess::kRead);
    EXPECT_EQ(map->remove({}), 0);
    EXPECT_EQ(map->remove(std::vector<int64_t>{20, 3, 7, 3}), 3);
    EXPECT_EQ(map->remove(std::vector<int64_t>{3, 4}), 1);
    EXPECT_EQ(map->remove(std::vector<int64_t>{3}), 0);
    expect_error<UsageError>(
        [&] {
          map->remove(std::vector<int64_t>{5, 21});
        },
        {"place 21", "1 to 20"});
    expect_error<UsageError>([&] { map->remove(std::vector<int64_t>{0}); }, {"place 0"});
    expect_error<UsageError>([&] { reader->remove(std::vector<int64_t>{5}); }, {"for reading"});
    expect_all_but(*map, 20, {3, 4, 7, 20});
    EXPECT_EQ(map->removed(), (std::vector<int64_t>{3, 7, 20, 4}));
    EXPECT_EQ(reader->removed(3), std::vector<int64_t>{4});
    expect_all_but(*reader, 20, {3, 4, 7, 20});
    EXPECT_EQ(map->add(some_places(21, 22)), (std::vector<int64_t>{21, 22}));
    // Removed entries are not described again for a new projection.
    EXPECT_TRUE(map->replace_descriptors([](const StoredPlace& place) { return place.descriptor; },
                                         {{kProjectionValue, "learnt"}}, 0));
    EXPECT_EQ(read_all(*reader).places.size(), 18);
  }
  EXPECT_EQ(check_map(file), std::vector<std::string>());
  EXPECT_EQ(open_map(file, MapAccess::kRead)->size(), 18);
  EXPECT_EQ(merge_maps(std::vector<fs::path>{file}, dir / "merged", [](const std::string&) {}), 18);
  EXPECT_EQ(check_map(dir / "merged"), std::vector<std::string>());
  EXPECT_TRUE(open_map(dir / "merged", MapAccess::kRead)->removed().empty());
  EXPECT_EQ(open_map(dir / "merged", MapAccess::kRead)->value(kProjectionValue), "learnt");
}

/// SQLite keeps the format version at byte 60 of the file.
int version_of(const fs::path& file) {
  return test::read_file(file).at(63);
}

TEST(RemovedPlaces, RaiseTheVersionSoThatNoOlderProgramTakesThemForLost) {
  const TempDir dir;
  writer_at(dir / "map")->add(some_places(1, 3));
  EXPECT_EQ(version_of(dir / "map"), 1);
  writer_at(dir / "map")->remove(std::vector<int64_t>{2});
  EXPECT_EQ(version_of(dir / "map"), 2);
  expect_all_but(*writer_at(dir / "map"), 3, {2});
}

TEST(RemovedPlaces, AListThatNoRemovalWritesIsDamage) {
  const TempDir dir;
  writer_at(dir / "map")->add(some_places(1, 9));
  writer_at(dir / "map")->remove(std::vector<int64_t>{2, 3});
  const std::string whole = test::read_file(dir / "map");
  const auto entry = [](int64_t id, int64_t place) {
    return str("INSERT INTO removed VALUES (", id, ",", place, ",", removed_checksum(id, place),
               ")");
  };
  // Damage: an existing entry, an entry twice, one that the list lacks, another number, and beyond
  // the largest number.
  for (const auto& [damage, said] :
       {std::pair<std::string, const char*>(entry(3, 5),
                                            "it has 7 places after place 0, expected 6"),
        {entry(3, 2), "it has 7 places after place 0, expected 6"},
        {"DELETE FROM removed WHERE place = 2", "it has 7 places after place 0, expected 8"},
        {"UPDATE removed SET place = 4 WHERE place = 2",
         "a checksum in the list of removed places"},
        {entry(INT64_MAX, 5), "it has 7 places after place 0, expected 6"}}) {
    SCOPED_TRACE(damage);
    test::write_file(dir / "copy", whole);
    execute_sql(dir / "copy", damage);
    const std::vector<std::string> wrong = check_map(dir / "copy");
    ASSERT_EQ(wrong.size(), 1);
    EXPECT_HAS(wrong[0], said);
  }
  expect_error<InputError>([&] { writer_at(dir / "copy")->remove(std::vector<int64_t>{6}); },
                           {"copy: this map is corrupt"});
}

/// Reports each acknowledged removal until it is killed.
void remove_for_ever(const fs::path& file, int64_t from, int pipe) {
  const auto map = writer_at(file);
  for (int64_t id = from;; ++id) {
    map->remove({&id, 1});
    if (::write(pipe, &id, sizeof(id)) != sizeof(id)) break;
  }
}

TEST(RemovedPlaces, AKillLeavesEachRemovalDoneWholeOrNotAtAll) {
  const TempDir dir;
  constexpr int64_t kPlaces = 4000;
  writer_at(dir / "map")->add(some_places(1, kPlaces));
  std::mt19937 random(11);
  std::set<int64_t> removed;
  for (int kill = 0; kill < 25; ++kill) {
    const auto from = static_cast<int64_t>(removed.size()) + 1;
    const auto wait = static_cast<int>(random() % 5000);
    const int64_t acknowledged =
        test::last_before_kill([&](int pipe) { remove_for_ever(dir / "map", from, pipe); },
                               kill % 4 != 0 ? 1 : 0, wait, from - 1);
    ASSERT_FALSE(HasFailure());

    const auto map = open_map(dir / "map", MapAccess::kRead);
    const std::vector<int64_t> now = map->removed();
    const auto last = static_cast<int64_t>(now.size());
    ASSERT_GE(last, acknowledged) << kill;
    ASSERT_LE(last, acknowledged + 1) << kill;
    removed = {now.begin(), now.end()};
    ASSERT_TRUE(removed.empty() || *removed.rbegin() == last);
    if (kill % 5 == 0) {
      expect_all_but(*map, kPlaces, removed);
      EXPECT_EQ(check_map(dir / "map"), std::vector<std::string>());
    }
  }
  EXPECT_GT(removed.size(), 20);
}

}  // namespace
}  // namespace revisit
