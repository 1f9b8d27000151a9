// Places that are removed from a map in a file: gone for good, and never taken for lost.
#include "removed_places.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <random>
#include <set>

#include "execute_sql.h"
#include "expect_error.h"
#include "killed_writer.h"
#include "read_map.h"
#include "test_data.h"

namespace revisit::pipeline {
namespace {

namespace fs = std::filesystem;
using test::execute_sql;
using test::expect_error;
using test::TempDir;

const MapIdentity kOfRemoved{{"feature", "ring"}};

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

/// Expects what was added as places 1 to `n`, but for those in `removed`.
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
    // Who watches the map sees it.
    EXPECT_EQ(reader->removed(3), std::vector<int64_t>{4});
    expect_all_but(*reader, 20, {3, 4, 7, 20});
    EXPECT_EQ(map->add(some_places(21, 22)), (std::vector<int64_t>{21, 22}));
    // What is described again for a new basis stays removed.
    EXPECT_TRUE(map->replace_descriptors([](const StoredPlace& place) { return place.descriptor; },
                                         {{kBasisValue, "learnt"}}, 0));
    EXPECT_EQ(read_all(*reader).places.size(), 18);
    // A frame that has no place any more can be described again.
    const int64_t frames[] = {4, 6};
    map->expect("even", frames);
    EXPECT_EQ(map->claim("even", 10)->frames, std::vector<int64_t>{4});
  }
  EXPECT_EQ(check_map(file), std::vector<std::string>());
  EXPECT_EQ(open_map(file, MapAccess::kRead)->size(), 18);
  EXPECT_EQ(merge_maps(std::vector<fs::path>{file}, dir / "merged", [](const std::string&) {}), 18);
  EXPECT_EQ(check_map(dir / "merged"), std::vector<std::string>());
  EXPECT_TRUE(open_map(dir / "merged", MapAccess::kRead)->removed().empty());
  EXPECT_EQ(open_map(dir / "merged", MapAccess::kRead)->value(kBasisValue), "learnt");
}

/// The version of a map's format, which SQLite keeps at byte 60 of the file.
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

TEST(RemovedPlaces, LostOnesAreStillNamedAndCanBeRemoved) {
  const TempDir dir;
  writer_at(dir / "map")->add(some_places(1, 9));
  writer_at(dir / "map")->remove(std::vector<int64_t>{4});
  // A byte of place 6, found by its descriptor.
  std::string bytes = test::read_file(dir / "map");
  const std::vector<float> six(100, 6.0F);
  const size_t at = bytes.find(std::string(reinterpret_cast<const char*>(six.data()), 400));
  ASSERT_NE(at, std::string::npos);
  ++bytes[at + 50];
  test::write_file(dir / "map", bytes);
  const std::vector<std::string> wrong = check_map(dir / "map");
  ASSERT_EQ(wrong.size(), 1);
  EXPECT_NE(wrong[0].find("place 6 is damaged"), std::string::npos) << wrong[0];
  EXPECT_EQ(writer_at(dir / "map")->remove(std::vector<int64_t>{6}), 1);
  expect_all_but(*writer_at(dir / "map"), 9, {4, 6});
  EXPECT_EQ(check_map(dir / "map"), std::vector<std::string>());
}

TEST(RemovedPlaces, WhatTheListLacksIsLostAndCanBeRemovedAgain) {
  const TempDir dir;
  writer_at(dir / "map")->add(some_places(1, 6));
  writer_at(dir / "map")->remove(std::vector<int64_t>{2, 3});
  execute_sql(dir / "map", "DELETE FROM removed WHERE place = 2");
  const std::vector<std::string> wrong = check_map(dir / "map");
  ASSERT_EQ(wrong.size(), 1);
  EXPECT_HAS(wrong[0], "place 2 is damaged: not found");
  const auto map = writer_at(dir / "map");
  EXPECT_EQ(map->remove(std::vector<int64_t>{2}), 1);
  EXPECT_EQ(check_map(dir / "map"), std::vector<std::string>());
  EXPECT_EQ(map->size(), 4);
  EXPECT_EQ(map->removed(2), std::vector<int64_t>{2});
}

TEST(RemovedPlaces, NumbersThatAreNoPlacesAreNotCounted) {
  const TempDir dir;
  writer_at(dir / "map")->add(some_places(1, 3));
  writer_at(dir / "map")->remove(std::vector<int64_t>{2});
  execute_sql(dir / "map",
              "INSERT INTO removed VALUES (2, 2.1, 0), (3, 2.2, 0), (4, 2.3, 0), (5, 'x', 0)");
  EXPECT_EQ(writer_at(dir / "map")->size(), 2);
}

TEST(RemovedPlaces, AListThatNoRemovalWritesIsNamed) {
  const TempDir dir;
  writer_at(dir / "map")->add(some_places(1, 9));
  writer_at(dir / "map")->remove(std::vector<int64_t>{2});
  const std::string whole = test::read_file(dir / "map");
  // A place twice, one that is there, one that there never was, and a gap in the numbers.
  for (const auto& [id, place, said] : {std::tuple(2, 2, "it has place 2 twice"),
                                        {2, 5, "place 5 is there"},
                                        {2, 10, "it has place 10, the map has had 9"},
                                        {7, 4, "place 4 is there"}}) {
    SCOPED_TRACE(said);
    test::write_file(dir / "copy", whole);
    execute_sql(dir / "copy", str("INSERT INTO removed VALUES (", id, ",", place, ",",
                                  removed_checksum(id, place), ")"));
    const std::vector<std::string> wrong = check_map(dir / "copy");
    ASSERT_FALSE(wrong.empty());
    EXPECT_NE(wrong[0].find(said), std::string::npos) << wrong[0];
  }
}

TEST(RemovedPlaces, DamageIsNamedInTheOrderOfPlaces) {
  const TempDir dir;
  writer_at(dir / "map")->add(some_places(1, 9));
  writer_at(dir / "map")->remove(std::vector<int64_t>{7});
  execute_sql(dir / "map", "DELETE FROM place WHERE id IN (2, 3)");
  execute_sql(dir / "map", str("INSERT INTO removed VALUES (2, 4,", removed_checksum(2, 4), ")"));
  const std::vector<std::string> wrong = check_map(dir / "map");
  ASSERT_EQ(wrong.size(), 2);
  EXPECT_HAS(wrong[0], "places 2 to 3 are damaged");
  EXPECT_HAS(wrong[1], "place 4 is there");
}

TEST(RemovedPlaces, NothingComesBehindTheLargestNumber) {
  const TempDir dir;
  writer_at(dir / "map")->add(some_places(1, 9));
  writer_at(dir / "map")->remove(std::vector<int64_t>{2});
  execute_sql(dir / "map", str("INSERT INTO removed VALUES (", INT64_MAX, ", 3,",
                               removed_checksum(INT64_MAX, 3), ")"));
  expect_error<InputError>([&] { writer_at(dir / "map")->remove(std::vector<int64_t>{5}); },
                           {"its last entry has the number 9223372036854775807"});
}

TEST(RemovedPlaces, AListThatCannotBeReadIsNamed) {
  const TempDir dir;
  writer_at(dir / "map")->add(some_places(1, 9));
  writer_at(dir / "map")->remove(std::vector<int64_t>{2});
  std::string bytes = test::read_file(dir / "map");
  char& kind_of_last_page = bytes[bytes.size() - 4096];
  ASSERT_EQ(kind_of_last_page, 13);  // rows of a table
  kind_of_last_page = 0;
  test::write_file(dir / "map", bytes);
  const WhatWasRead read = read_all(*open_map(dir / "map", MapAccess::kRead));
  EXPECT_EQ(read.places.size(), 8);
  ASSERT_EQ(read.damages.size(), 2);
  EXPECT_HAS(read.damages[0], "the list of removed places is damaged: database disk image");
  EXPECT_HAS(read.damages[1], "place 2");
}

TEST(RemovedPlaces, NoDamagedByteBringsOneBackOrHidesALoss) {
  const TempDir dir;
  constexpr int64_t kPlaces = 60;
  std::vector<int64_t> removed;
  for (int64_t id = 2; id <= kPlaces; id += 3) removed.push_back(id);
  {
    const auto map = writer_at(dir / "map");
    map->add(some_places(1, kPlaces));
    map->remove(removed);
  }
  const std::string whole = test::read_file(dir / "map");
  std::mt19937 random(7);
  int64_t named = 0;
  for (int flip = 0; flip < 400; ++flip) {
    std::string bytes = whole;
    size_t at = random() % bytes.size();
    if (flip % 2 == 0) at = std::min(bytes.size() - 1, at / 4096 * 4096 + random() % 120);
    const char old = bytes[at];
    while (bytes[at] == old) bytes[at] = static_cast<char>(random());
    test::write_file(dir / "copy", bytes);
    SCOPED_TRACE("byte " + std::to_string(at));
    try {
      const WhatWasRead read = read_all(*open_map(dir / "copy", MapAccess::kRead));
      for (const StoredPlace& place : read.places) {
        EXPECT_EQ(std::ranges::count(removed, place.id), 0) << place.id << " came back";
        EXPECT_TRUE(same(place, some_places(place.id, place.id)[0]));
      }
      EXPECT_TRUE(read.places.size() + removed.size() == kPlaces || !read.damages.empty());
      named += read.damages.empty() ? 0 : 1;
    } catch (const InputError&) {
    }
  }
  EXPECT_GT(named, 20);
}

/// Removes places one by one and says each that was acknowledged, until it is killed.
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
}  // namespace revisit::pipeline
