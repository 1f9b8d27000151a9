#include "revisit/maps/map.h"

#include "coordinates.h"
#include "map_file.h"
#include "map_format.h"
#include "maps.h"
#include "revisit/recognition/ring/descriptor.h"
#include "sqlite_driver.h"
#include "street.h"
#include "testing.h"

namespace revisit {
namespace {

/// Entry i of a walk with a revisit: scans i and i + 100 are nearly equal.
PointCloud scan_of(int i) {
  std::mt19937 of_place(static_cast<unsigned>(i % 100)), of_scan(static_cast<unsigned>(1000 + i));
  std::normal_distribution<float> gaussian;
  PointCloud cloud;
  for (int p = 0; p < 2; ++p) {
    Point point{5 + gaussian(of_place), gaussian(of_place), gaussian(of_place), 0};
    point.x += 0.01F * gaussian(of_scan);
    cloud.points.push_back(point);
  }
  return cloud;
}

std::vector<float> coordinates_of(int i) {
  std::vector<float> feature;
  for (const Point& p : scan_of(i).points) feature.insert(feature.end(), {p.x, p.y, p.z});
  return feature;
}

Description described(const Map& map, int i) {
  return map.describe(view_of(scan_of(i)));
}

std::optional<Loop> best_match(const Map& map, int i) {
  return map.query(described(map, i));
}

/// Index and similarities.
using Found = std::tuple<int64_t, double, double>;

/// Returns each scan's match.
std::vector<Found> drive(Map& map, int first, int last) {
  std::vector<Found> found;
  for (int i = first; i < last; ++i) {
    const Description scan = described(map, i);
    const Loop loop = map.query(scan).value_or(Loop{.index = -1});
    found.emplace_back(loop.index, loop.similarity, loop.kth_similarity);
    EXPECT_EQ(add_scan(map, scan, {.frame = 10 * i}), i);
  }
  return found;
}

TEST(Map, FindsMatchesWithTheirProperties) {
  Map map(coordinates(), {.warmup = 30});
  drive(map, 0, 100);
  for (int i = 100; i < 130; ++i) {
    const Description scan = described(map, i);
    const auto loop = map.query(scan);
    ASSERT_TRUE(loop);
    EXPECT_EQ(loop->index, i - 100);
    EXPECT_EQ(loop->frame, 10 * (i - 100));
    EXPECT_GT(loop->similarity, 0.99);
    EXPECT_EQ(loop->score, 2 * loop->similarity - loop->kth_similarity);
    std::vector<float> entry{scan_of(i - 100).points[0].x};
    round_feature(entry);  // as the map does
    EXPECT_NEAR(*loop->relative_yaw, scan_of(i).points[0].x - entry[0], 1e-5);
  }
  const MapEntry entry = map.entry(7);
  EXPECT_EQ(std::tuple(entry.id, entry.frame, entry.feature.size()), std::tuple(8, 70, 0U));
  EXPECT_EQ(map.distinct(), 100) << "its similarities do not tell";
  EXPECT_EQ(map.around(7, true), std::vector<int64_t>{7});
  for (const int64_t odd : {-1, 100})
    expect_error<UsageError>([&] { map.around(odd); }, {str("no entry has the index ", odd)});
}

/// Interruptions at any entry, during or after the warm-up.
TEST(Map, GivesTheSameMatchesWhenOpenedAgain) {
  Map whole(coordinates(), {.warmup = 30});
  const std::vector<Found> expected = drive(whole, 0, 130);
  const TempDir folder;
  for (const int stop : {1, 2, 17, 29, 30, 31, 100}) {
    std::vector<Found> found;
    for (const auto& [from, to] : {std::pair(0, stop), {stop, 130}}) {
      const auto map = file_map(folder / str(stop), coordinates(), {.warmup = 30});
      EXPECT_EQ(map->size(), from);
      std::ranges::copy(drive(*map, from, to), std::back_inserter(found));
    }
    EXPECT_EQ(found, expected) << stop;
  }
  // Entries of a warm-up are described again: as those of a map that has the projection before.
  copy_projection(*map_in(folder / "late", coordinates()), folder / "1", nullptr);
  const auto late = file_map(folder / "late", coordinates(), {.warmup = 30});
  const std::vector<Found> found = drive(*late, 0, 130);
  EXPECT_TRUE(std::equal(found.begin() + 30, found.end(), expected.begin() + 30));
}

/// Adds the scans that the map lacks, in batches, and closes it after every second one. Returns the
/// projection; nullopt during the warm-up.
std::optional<std::string> grow(const fs::path& file, const FeatureExtractor& extractor,
                                const std::vector<int>& numbers, int64_t at_once,
                                int64_t warmup = 10) {
  const auto n = std::ssize(numbers);
  for (bool first = true; first || reader_of(file)->size() < n; first = false) {
    const auto map = file_map(file, extractor, {.warmup = warmup});
    for (int batch = 0; batch < 2; ++batch) {
      std::vector<MapEntry> entries;
      for (int64_t i = map->size(); i < n && std::ssize(entries) < at_once; ++i)
        entries.push_back({.frame = i, .feature = coordinates_of(numbers[i])});
      map->add(entries);
      EXPECT_TRUE(best_match(*map, numbers[0]));
    }
  }
  EXPECT_EQ(reader_of(file)->size(), n);
  return reader_of(file)->value(kProjectionValue);
}

TEST(Map, ProjectionDependsOnTheWarmUpOnly) {
  const TempDir folder;
  std::vector<int> all(40);
  std::iota(all.begin(), all.end(), 0);
  const auto projection = grow(folder / "one by one", coordinates(), all, 1);
  ASSERT_TRUE(projection);
  for (const int64_t at_once : {4, 8, 16, 40})
    EXPECT_EQ(grow(folder / str(at_once), coordinates(), all, at_once), projection) << at_once;
  // Another process completes the warm-up of a killed one, also without a scan.
  for (const int added : {10, 24, 40}) {
    const fs::path file = folder / str("killed at ", added);
    const std::vector<int> some(all.begin(), all.begin() + added);
    EXPECT_EQ(grow(file, coordinates(), some, 8, 1000), std::nullopt);
    EXPECT_EQ(grow(file, coordinates(), all, 8), projection) << added;
  }
}

TEST(Map, WarmUpCountsDistinctPlaces) {
  const TempDir folder;
  auto projection_of = [&, files = 0](const std::vector<int>& numbers, int64_t at_once) mutable {
    return grow(folder / str(++files), coordinates(0.999), numbers, at_once);
  };
  std::vector<int> once, halts;
  for (int i = 0; i < 10; ++i) {
    once.push_back(i);
    halts.insert(halts.end(), 1 + i % 3, i);
  }
  const auto expected = projection_of(once, 1);
  ASSERT_TRUE(expected);
  for (const int64_t at_once : {1, 2, 7, 40}) EXPECT_EQ(projection_of(halts, at_once), expected);
  halts.pop_back();
  EXPECT_EQ(projection_of(halts, 3), std::nullopt) << "the tenth came once only";
  // It ends with few distinct places, too, so that the memory of its entries is bounded.
  std::vector<int> standing(49, 3);
  standing[0] = 0;  // equal to its own mean
  EXPECT_EQ(projection_of(standing, 7), std::nullopt);
  standing.push_back(3);
  const auto projection = projection_of(standing, 7);
  ASSERT_TRUE(projection);
  standing.insert(standing.end(), {4, 5, 6});
  for (const int64_t at_once : {1, 60}) EXPECT_EQ(projection_of(standing, at_once), projection);
}

TEST(Map, ScoresByDistinctPlaces) {
  const auto score_of = [](const FeatureExtractor& extractor, std::optional<Score> score) {
    return Map(extractor, {.score = score}).options().score;
  };
  EXPECT_EQ(score_of(coordinates(), {}), Score::kMargin);
  EXPECT_EQ(score_of(coordinates(), Score::kSimilarity), Score::kSimilarity);
  EXPECT_EQ(score_of(coordinates(0.9), {}), Score::kDistinctMargin);
  EXPECT_EQ(score_of(coordinates(0.9), Score::kMargin), Score::kMargin);
  // A minute at the same place: the fourth scan looks like the first, but is no distinct place.
  // Neither are skipped or removed entries.
  Map map(coordinates(0.99), {.warmup = 10});
  drive(map, 0, 60);
  std::vector<int64_t> same(1, 7);
  for (int i = 0; i < 600; ++i) same.push_back(add_scan(map, described(map, 107), {.frame = i}));
  const Description scan = described(map, 207);
  const auto loop = map.query(scan);
  EXPECT_LT(loop->kth_similarity, 0.98);
  EXPECT_EQ(loop->score, 2 * loop->similarity - loop->kth_similarity);
  Map once(coordinates(0.99), {.warmup = 10});
  drive(once, 0, 60);
  EXPECT_EQ(once.query(scan)->kth_similarity, loop->kth_similarity);
  EXPECT_EQ(once.query(scan, std::vector<int64_t>{7})->index, map.query(scan, same)->index);
}

/// Changes every two meters; in a tunnel from 60 to 120 m, only noise differs.
Description seen_at(double meters, int pass = 0) {
  const bool tunnel = meters >= 60 && meters < 120;
  std::vector<float> feature(kNumbers, tunnel ? 1.0F : 0.0F);
  const auto see = [&](int thing, double share) {
    feature[static_cast<size_t>(thing % kNumbers)] += static_cast<float>(share);
  };
  const auto thing = static_cast<int>(meters / 2);
  if (!tunnel) {
    see(thing, thing + 1 - meters / 2);
    see(thing + 1, meters / 2 - thing);
  }
  std::mt19937 random(static_cast<unsigned>(static_cast<int>(10 * meters) + 7919 * pass));
  std::normal_distribution<float> noise(0, tunnel ? 0.3F : 0.02F);
  for (float& number : feature) number += noise(random);
  return {.feature = feature, .error = ""};
}

/// Along the street.
struct Drive {
  bool poses = true;
  std::string name = "d";
  int64_t frame = 0;

  void add(Map& map, double meters) {
    MapEntry entry{.drive = name, .frame = frame++};
    if (poses) entry.pose.emplace(Eigen::Translation3d(meters, 0, 0));
    add_scan(map, seen_at(meters), entry);
  }
};

/// Starts [m] of the stretches of 5 m where most loops are ambiguous.
std::vector<int> ambiguous_meters(const Map& map) {
  std::vector<int> meters;
  for (int from = 0; from < 200; from += 5) {
    int ambiguous = 0;
    for (int i = 0; i < 10; ++i) {
      const auto loop = map.query(seen_at(from + 0.5 * i + 0.25, 99));
      ambiguous += loop->ambiguous ? 1 : 0;
    }
    if (ambiguous > 5) meters.push_back(from);
  }
  return meters;
}

const std::vector<int> kTunnel = {60, 65, 70, 75, 80, 85, 90, 95, 100, 105, 110, 115};
constexpr double kSamePlace = 0.65;
const MapOptions kOptions = {.warmup = 30};

TEST(Map, MatchesInATunnelAreAmbiguous) {
  for (const bool poses : {true, false})
    for (const double step : {0.1, 0.5, 1.5, 3.0})  // dense drives and keyframes
      for (const int64_t warmup : {2, 30, 1000}) {
        SCOPED_TRACE(testing::Message() << poses << ' ' << step << ' ' << warmup);
        Map map(coordinates(kSamePlace), {.warmup = warmup});
        Drive walk{.poses = poses};
        for (double meters = 0; meters < 200; meters += step) walk.add(map, meters);
        EXPECT_EQ(ambiguous_meters(map), kTunnel);
      }
}

/// Two robots alternate. Blocks of their scans are described by several machines, and the map is
/// opened again for each; some entries are removed.
TEST(Map, FindsTunnelsInAnyMap) {
  const TempDir folder;
  const auto open = [&] { return file_map(folder / "map", coordinates(kSamePlace), kOptions); };
  for (const int block : {1, 0, 3, 2, 5, 4, 7, 6, 9, 8}) {
    const auto map = open();
    Drive here{.name = "here", .frame = int64_t{40} * block}, there = here;
    there.poses = false;
    there.name = "there";
    for (double meters = 20 * block; meters < 20 * (block + 1); meters += 0.5) {
      here.add(*map, meters);
      there.add(*map, 1000 + meters);
    }
  }
  const auto map = open();
  map->remove(std::vector<int64_t>{10, 12, 200});
  EXPECT_EQ(ambiguous_meters(*map), kTunnel);
}

/// Fails once, at the first statement with `breaks_at`, or after `rows_left` of its rows.
struct BreakingDriver : SqliteDriver {
  explicit BreakingDriver(const fs::path& file)
      : SqliteDriver(file, SQLITE_OPEN_READWRITE, "the map") {}
  void execute(const std::string& sql, const std::vector<SqlValue>& values,
               const Take& take) override {
    const bool breaks = !breaks_at.empty() && sql.find(breaks_at) != std::string::npos;
    const auto count_down = [&] {
      if (!breaks || rows_left-- > 0) return;
      breaks_at.clear();
      throw Error("lost");
    };
    if (rows_left == 0) count_down();
    SqliteDriver::execute(sql, values, [&](const SqlRow& row) {
      count_down();
      if (take) take(row);
    });
  }
  std::string breaks_at;
  int rows_left = 0;
};

TEST(Map, RefreshResumesAfterAnError) {
  FeatureExtractor extractor = coordinates();
  extractor.fit_projection = nullptr;
  const TempDir folder;
  const auto other = map_in(folder / "map", extractor);
  auto driver = std::make_unique<BreakingDriver>(folder / "map");
  BreakingDriver& breaking = *driver;
  Map map(extractor, {}, std::make_unique<MapStore>(std::move(driver), MapAccess::kWrite));
  for (int id = 1; id <= 6; ++id)
    other->add(std::vector{MapEntry{.descriptor = coordinates_of(id)}});
  breaking.breaks_at = "FROM entry";
  breaking.rows_left = 3;
  expect_error<Error>([&] { map.refresh(); }, {"lost"});
  EXPECT_EQ(map.size(), 3);
  map.refresh();
  EXPECT_EQ(map.size(), 6);
  const Description scan = described(map, 105);
  EXPECT_EQ(map.query(scan)->id, 5);
  other->remove(std::vector<int64_t>{5});
  breaking.breaks_at = "checksum FROM removed";
  expect_error<Error>([&] { map.refresh(); }, {"lost"});
  map.refresh();
  EXPECT_NE(map.query(scan)->id, 5);
}

TEST(Map, AddsEntriesIfTheWarmUpCannotEnd) {
  const TempDir folder;
  map_in(folder / "map", coordinates());
  auto driver = std::make_unique<BreakingDriver>(folder / "map");
  driver->breaks_at = "UPDATE entry";
  std::vector<std::string> warnings;
  Map map(coordinates(), {.warmup = 3},
          std::make_unique<MapStore>(std::move(driver), MapAccess::kWrite), into(warnings));
  drive(map, 0, 3);
  EXPECT_EQ(map.size(), 3);
  EXPECT_FALSE(map.is_warmed_up());
  drive(map, 3, 4);
  EXPECT_TRUE(map.is_warmed_up());
  ASSERT_EQ(warnings.size(), 1U);
  EXPECT_HAS(warnings[0], "lost");
  EXPECT_EQ(best_match(map, 102)->index, 2);
}

TEST(Map, SkipsUnusableEntries) {
  const TempDir folder;
  std::vector<MapEntry> entries(4);
  for (int i = 0; i < 4; ++i) {
    std::vector<float> feature = coordinates_of(i);
    if (i == 1 || i == 2) feature[2] = 3e38F;  // their sum would be infinite
    entries[i].feature = entries[i].descriptor = feature;
  }
  entries[0] = {.descriptor = {1, 2, 3}};
  map_in(folder / "a.map", coordinates())->add(entries);
  std::vector<std::string> problems;
  const auto open = [&] {
    problems.clear();
    return file_map(folder / "a.map", coordinates(), {.warmup = 10}, into(problems));
  };
  auto map = open();
  ASSERT_EQ(problems.size(), 3);
  EXPECT_HAS(problems[0], "entry 1 is skipped: its feature has 0 dimensions, expected 6");
  EXPECT_HAS(problems[1], "a.map: entry 2 is skipped: its feature has numbers that are not fini");
  EXPECT_EQ(check_map(folder / "a.map").size(), 3);
  EXPECT_EQ(map->size(), 1);
  for (int i = 1; i < 30; ++i) add_scan(*map, described(*map, i));  // beyond the warm-up's end
  map.reset();
  map = open();
  ASSERT_EQ(problems.size(), 3);
  EXPECT_HAS(problems[0], "its descriptor has 3 dimensions, expected 6");
  EXPECT_EQ(map->size(), 30);
  EXPECT_EQ(best_match(*map, 107)->id, 11);
  EXPECT_EQ(check_map(folder / "a.map").size(), 3);
}

TEST(Map, DoesExpensiveWorkOnce) {
  int fits = 0, made = 0;
  FeatureExtractor counting = coordinates();
  counting.fit_projection = [&, inner = counting.fit_projection](const Rows& features,
                                                                 std::span<const int64_t> rows) {
    ++fits;
    return inner(features, rows);
  };
  counting.make = [&, make = std::get<FeatureMaker<PointCloud>>(counting.make)] {
    ++made;
    return make();
  };
  const TempDir folder;
  drive(*file_map(folder / "a.map", coordinates(), {.warmup = 100}), 0, 60);
  const auto map = file_map(folder / "a.map", counting, {.warmup = 10});
  EXPECT_EQ(fits, 1);
  drive(*map, 60, 70);  // completes the warm-up, from its entries alone
  EXPECT_EQ(fits, 1);
  EXPECT_EQ(made, 1) << "not for each scan";
}

TEST(Map, ExcludesIndicesInAnyOrder) {
  Map map(coordinates(), {.warmup = 2, .k = 1});
  for (int i = 0; i < 5; ++i) add_scan(map, described(map, i), {.frame = i});
  const Description scan = described(map, 103);
  EXPECT_EQ(map.query(scan, std::vector<int64_t>{9, -4, INT64_MAX, 2, 0})->index, 3);
  EXPECT_EQ(map.query(scan, std::vector<int64_t>{4, 3, 1, 0, 3})->index, 2);
  EXPECT_FALSE(map.query(scan, std::vector<int64_t>{4, 3, 2, 1, 0, INT64_MIN}));
}

TEST(Map, FollowsAdditionsAndRemovals) {
  const TempDir folder;
  using Indices = std::vector<int64_t>;
  for (const int64_t warmup : {1000, 10}) {  // during and after the warm-up
    const fs::path file = folder / str(warmup);
    const auto open = [&] { return file_map(file, coordinates(), {.warmup = warmup}); };
    auto writer = open();
    drive(*writer, 0, 5);
    Map reader(coordinates(), {.warmup = warmup}, reader_of(file));
    const int64_t before = reader.refresh();
    EXPECT_EQ(reader.refresh(), before);
    drive(*writer, 5, 60);
    EXPECT_EQ(reader.size(), 5);
    EXPECT_EQ(reader.refresh(), before + 1);
    const Description scan = described(reader, 107);
    for (Map* one : {&*writer, &reader}) {
      EXPECT_EQ(one->refresh(), one->refresh());
      EXPECT_EQ(one->size(), 60);
      EXPECT_EQ(one->query(scan)->index, 7);
      EXPECT_EQ(one->query(scan)->similarity, writer->query(scan)->similarity);
    }
    EXPECT_EQ(writer->remove(Indices{7, 30, 7}), 2);
    EXPECT_EQ(writer->remove(Indices{7}), 0);
    EXPECT_FALSE(writer->entries_of("").contains(70));
    EXPECT_TRUE(writer->entries_of("").contains(80));
    expect_error<UsageError>([&] { writer->remove(Indices{60}); }, {"index 60"});
    // The others keep their indices, and a new entry gets the next one.
    EXPECT_EQ(writer->size(), 60);
    drive(*writer, 60, 70);
    reader.refresh();
    for (const Map* one : {&*writer, &reader}) {
      EXPECT_NE(one->query(scan)->index, 7);
      EXPECT_EQ(best_match(*one, 108)->index, 8);
      EXPECT_EQ(best_match(*one, 165)->index, 65);
    }
    add_scan(*writer, described(*writer, 7), {.drive = "later", .frame = 70});
    EXPECT_EQ(writer->query(scan)->drive, "later");
    writer.reset();
    writer = open();
    EXPECT_EQ(writer->size(), 69);
    EXPECT_EQ(writer->query(scan)->drive, "later");
    EXPECT_EQ(best_match(*writer, 108)->id, 9);
  }
  Map temporary(coordinates(), {.warmup = 2});
  drive(temporary, 0, 10);
  EXPECT_EQ(temporary.remove(Indices{3}), 1);
  EXPECT_NE(best_match(temporary, 103)->index, 3);
}

TEST(Map, RejectsScansThatCannotBeDescribed) {
  Map map(coordinates(), {});
  PointCloud one, far = scan_of(0);
  one.points.push_back({1, 2, 3, 0});
  far.points[1].z = 1e10F;
  for (const auto& [cloud, error] :
       {std::pair(PointCloud(), "the scan has no points"),
        {one, "fewer than two points"},
        {far, "its feature has numbers that are not finite, or above 1e9"}}) {
    const Description scan = map.describe(view_of(cloud));
    EXPECT_FALSE(scan.described());
    EXPECT_EQ(scan.error, error);
    EXPECT_FALSE(map.query(scan));
    expect_error<UsageError>([&] { add_scan(map, scan); }, {"has 0 dimensions"});
  }
  for (int i = 0; i < 2; ++i) {  // without and with entries
    for (const float number : {3e9F, NAN, -INFINITY, 0.0F}) {
      Description odd{.feature = {1, 2, 3, 4, 5, number}, .error = ""};
      if (number == 0) odd.feature.resize(2);
      const char* why = number == 0 ? "has 2 dimensions" : "not finite, or above 1e9";
      expect_error<UsageError>([&] { add_scan(map, odd); }, {why});
      expect_error<UsageError>([&] { map.query(odd); }, {why});
    }
    add_scan(map, described(map, i));
  }
  EXPECT_EQ(map.size(), 2);
}

constexpr Lidar kVlp16{16, 15, -15};

TEST(Map, FindsItsSensorInTheFirstScan) {
  const TempDir folder;
  const fs::path file = folder / "site.map";
  std::vector<std::string> messages;
  {
    Map map(file, {}, into(messages));
    EXPECT_EQ(map.describe({}).error, "the scan has no points");
    EXPECT_TRUE(map.size() == 0 && map.distinct() == 0 && !map.is_warmed_up());
    EXPECT_TRUE(map.drives().empty() && map.entries_of("").empty() && !map.refresh());
    EXPECT_TRUE(map.extractor() == nullptr && map.options().sensor.empty() && !map.query({}));
    const Description early{.feature = {1, 2}, .error = ""};
    expect_error<UsageError>([&] { map.query(early); }, {"describe a scan first"});
    expect_error<UsageError>([&] { add_scan(map, early); }, {"describe a scan first"});
    PointCloud few = street(kVlp16);
    few.points.resize(300);
    EXPECT_HAS(map.describe(view_of(few)).error, "has 300 returns, too few");
    const Description scan = map.describe(view_of(street(kVlp16)));
    ASSERT_EQ(messages.size(), 1);
    EXPECT_HAS(messages[0], "sensor: vlp16 (16 beams");
    EXPECT_EQ(map.options().sensor, "vlp16");
    add_scan(map, scan);
    EXPECT_EQ(map.query(scan)->index, 0);
  }
  for (const MapAccess access : {MapAccess::kRead, MapAccess::kWrite}) {
    const Map again(file, {.access = access}, into(messages));
    EXPECT_TRUE(again.extractor() != nullptr && again.size() == 1);
    EXPECT_EQ(again.options().sensor, "vlp16");
  }
  EXPECT_EQ(messages.size(), 1);
  expect_error<InputError>([&] { Map(file, {.sensor = "hdl64"}); }, {"feature"});
  expect_error<InputError>([&] { Map(folder / "none", {.access = MapAccess::kRead}); }, {"none"});
  map_in(folder / "other", coordinates());
  expect_error<InputError>([&] { Map(folder / "other"); },
                           {"not that of a shipped ring model", "coordinates 1"});
}

TEST(Map, RejectsMapsAndScansOfOtherFeatures) {
  const TempDir folder;
  map_in(folder / "a.map", coordinates());
  expect_error<InputError>(
      [&] { map_in(folder / "a.map", coordinates(), {.align = AlignCase::kOne}); },
      {"alignment", "case1", "none"});
  FeatureExtractor other = coordinates();
  other.key = "coordinates 2";
  // The map was opened without a fingerprint.
  auto map = open_map(folder / "a.map", MapAccess::kRead);
  expect_error<InputError>([&] { Map(other, {}, std::move(map)); },
                           {"coordinates 1", "coordinates 2"});
  EXPECT_TRUE(map) << "it stays with the caller";
  Map own(coordinates(), {});
  add_scan(own, described(own, 0));
  const Description scan = described(Map(other, {}), 1);
  for (const std::function<void()>& work :
       {std::function<void()>([&] { own.query(scan); }), {[&] { own.similarity(scan, 0); }}, {[&] {
          own.add({{.feature = scan.feature}}, scan.made_by);
        }}})
    expect_error<UsageError>(work, {"'coordinates 2'", "'coordinates 1'"});
  FeatureExtractor camera = coordinates();
  camera.make = FeatureMaker<GrayImage>();
  expect_error<UsageError>([&] { Map(camera, {}); }, {"camera images"});
  for (const auto& [options, why] :
       {std::pair(MapOptions{.warmup = 1}, "warm-up: expected at least 2 entries, found 1"),
        {{.k = 0}, "k: expected at least 1, found 0"},
        {{.local_map = 500}, "local map: expected 1 to 200 m, found 500"},
        {{.hnsw_candidates = -1}, "HNSW candidates: expected at least 0"}}) {
    expect_error<UsageError>([&] { Map(coordinates(), options); }, {why});
    expect_error<UsageError>([&] { Map("", options); }, {why});
  }
}

TEST(Map, ComparesHnswCandidatesExactly) {
  FeatureExtractor rings = coordinates();
  rings.comparison = ring_comparison({});
  Map(rings, {});
#ifndef REVISIT_HAVE_FAISS
  for (const auto& use :
       std::vector<std::function<void()>>{[] { Map(coordinates(), {.hnsw_candidates = 30}); },
                                          [] { make_hnsw_source(PlaceIndex(4)); }})
    expect_error<UsageError>(use, {"candidates of a large map", "FAISS"});
  GTEST_SKIP() << "built without FAISS";
#endif
  expect_error<UsageError>([&] { Map(rings, {.hnsw_candidates = 30}); },
                           {"HNSW candidates", "cosine", rings.name});
  expect_error<UsageError>([] { make_hnsw_source(PlaceIndex(4)); }, {"it has no entries"});
  expect_error<UsageError>(
      [] {
        make_hnsw_source(PlaceIndex(4, ring_comparison({2, 1})));
      },
      {"not compared by cosine"});
  std::vector<MapEntry> entries(2300);
  std::mt19937 random(8);
  std::normal_distribution<float> gaussian;
  for (MapEntry& entry : entries)
    for (int64_t i = 0; i < kNumbers; ++i) entry.feature.push_back(gaussian(random));
  Map all(coordinates(), {.warmup = 20});
  all.add(entries);
  const TempDir dir;
  std::unique_ptr<Map> graph;
  for (const auto& [first, last] : {std::pair(0, 2000), {2000, 2300}}) {
    graph.reset();
    graph = file_map(dir / "map", coordinates(), {.warmup = 20, .hnsw_candidates = 100});
    graph->add({entries.begin() + first, entries.begin() + last});
  }
  int same = 0;
  for (int64_t i = 0; i < 2300; i += 23) {
    const Description scan{.feature = entries[i].feature, .error = ""};
    const auto a = all.query(scan, {&i, 1}), b = graph->query(scan, {&i, 1});
    EXPECT_NE(b->index, i);
    same += a->index == b->index && a->score == b->score ? 1 : 0;
  }
  EXPECT_GE(same, 95);
}

TEST(Map, IsThreadSafe) {
  Map map(coordinates(), {.warmup = 30});
  drive(map, 0, 100);
  std::vector<std::thread> threads;
  std::atomic<int> right = 0;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      for (int i = t; i < 100; i += 4) {
        const Description scan = described(map, 100 + i);
        const auto loop = map.query(scan);
        right += loop->frame % 1000 == 10 * i;
        add_scan(map, scan, {.frame = 1000 + 10 * i});
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(right, 100);
  EXPECT_EQ(map.size(), 200);
}

}  // namespace
}  // namespace revisit
