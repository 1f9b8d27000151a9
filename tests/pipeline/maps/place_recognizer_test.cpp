#include "revisit/maps/place_recognizer.h"

#include "coordinates.h"
#include "execute_sql.h"
#include "map_format.h"
#include "revisit/evaluation/descriptors.h"
#include "revisit/recognition/ring/descriptor.h"
#include "sqlite_driver.h"
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

Description described(const PlaceRecognizer& recognizer, int i) {
  return recognizer.describe(view_of(scan_of(i)));
}

auto best_match(const PlaceRecognizer& recognizer, int i) {
  return recognizer.query(described(recognizer, i));
}

std::function<void(const std::string&)> into(std::vector<std::string>& messages) {
  return [&messages](const std::string& message) { messages.push_back(message); };
}

std::unique_ptr<MapStore> map_in(const std::filesystem::path& file,
                                 const RecognizerOptions& options = {}) {
  const MapFingerprint fingerprint = PlaceRecognizer::fingerprint_of(coordinates(), options);
  return open_map(file, MapAccess::kWrite, &fingerprint);
}

/// Returns the index of each scan's match.
std::vector<int64_t> drive(PlaceRecognizer& recognizer, int first, int last) {
  std::vector<int64_t> found;
  for (int i = first; i < last; ++i) {
    const Description scan = described(recognizer, i);
    const auto loop = recognizer.query(scan);
    found.push_back(loop ? loop->index : -1);
    EXPECT_EQ(recognizer.add(scan, {.frame = 10 * i}), i);
  }
  return found;
}

TEST(PlaceRecognizer, FindsMatchesWithTheirProperties) {
  PlaceRecognizer recognizer(coordinates(), {.warmup = 30, .threshold = 0.5});
  drive(recognizer, 0, 100);
  for (int i = 100; i < 130; ++i) {
    const Description scan = described(recognizer, i);
    const auto loop = recognizer.query(scan);
    ASSERT_TRUE(loop);
    EXPECT_EQ(loop->index, i - 100);
    EXPECT_EQ(loop->frame, 10 * (i - 100));
    EXPECT_GT(loop->similarity, 0.99);
    EXPECT_LE(loop->kth_similarity, loop->similarity);
    EXPECT_EQ(loop->score, 2 * loop->similarity - loop->kth_similarity);
    EXPECT_EQ(loop->accepted, loop->score >= 0.5);
    EXPECT_NEAR(*loop->relative_yaw, scan_of(i).points[0].x - scan_of(i - 100).points[0].x,
                0.02);  // a map rounds its features
    const int64_t without[] = {i - 100};
    EXPECT_NE(recognizer.query(scan, without)->index, i - 100);
  }
}

TEST(PlaceRecognizer, DescribesWarmUpEntriesAgain) {
  const FeatureExtractor extractor = coordinates();
  PlaceRecognizer recognizer(extractor, {.warmup = 30});
  drive(recognizer, 0, 60);
  // Expected mean, of the first 30.
  FloatMatrix features(60, kNumbers);
  const FeatureFunction<PointCloud> describe = from_scan(extractor, AlignCase::kNone, {});
  for (int i = 0; i < 60; ++i) {
    describe(scan_of(i), features.row(i));
    round_feature(features.row(i));
  }
  std::vector<int64_t> first(30);
  std::iota(first.begin(), first.end(), 0);
  const Projection projection = extractor.fit_projection(features.rows(), first);
  FloatMatrix descriptors(61, kNumbers);
  for (int i = 0; i < 60; ++i) projection.describe(features.row(i), descriptors.row(i));
  const PointCloud query = scan_of(107);
  std::vector<float> feature(kNumbers);
  describe(query, feature);
  projection.describe(feature, descriptors.row(60));
  Task task;
  for (int64_t i = 0; i < 60; ++i) task.stored.push_back(i);
  task.queries.push_back({60, {{{0, 60}, {}}}});
  const Match expected = retrieve({descriptors}, task).front();
  const auto loop = recognizer.query(recognizer.describe(view_of(query)));
  EXPECT_EQ(loop->index, expected.ranks[0]);
  EXPECT_EQ(loop->similarity, expected.similarities[0]);
  EXPECT_EQ(loop->kth_similarity, expected.similarities[3]);
}

/// Interruptions at any entry, during or after the warm-up.
TEST(PlaceRecognizer, GivesTheSameMatchesWhenOpenedAgain) {
  PlaceRecognizer whole(coordinates(), {.warmup = 30});
  const std::vector<int64_t> expected = drive(whole, 0, 130);
  for (const int stop : {1, 2, 17, 29, 30, 31, 100}) {
    SCOPED_TRACE(stop);
    const TempDir folder;
    std::vector<int64_t> found;
    {
      PlaceRecognizer before(coordinates(), {.warmup = 30}, map_in(folder / "a.map"));
      found = drive(before, 0, stop);
    }
    PlaceRecognizer after(coordinates(), {.warmup = 30}, map_in(folder / "a.map"));
    EXPECT_EQ(after.size(), stop);
    const std::vector<int64_t> rest = drive(after, stop, 130);
    found.insert(found.end(), rest.begin(), rest.end());
    EXPECT_EQ(found, expected);
  }
}

/// Adds the missing scans below 40, at most `most`, `at_once` per transaction; returns the
/// projection.
std::optional<std::string> build(const std::filesystem::path& file, int64_t warmup, int64_t at_once,
                                 int64_t most = 40) {
  PlaceRecognizer recognizer(coordinates(), {.warmup = warmup}, map_in(file));
  const std::map<int64_t, int64_t> there = recognizer.entries_of("x");
  std::vector<Description> scans;
  std::vector<MapEntry> entries;
  for (int64_t frame = 0; frame < most; ++frame) {
    if (there.contains(frame)) continue;
    scans.push_back(described(recognizer, static_cast<int>(frame)));
    entries.push_back({.drive = "x", .frame = frame});
    if (std::ssize(scans) < at_once) continue;
    recognizer.add(std::exchange(scans, {}), std::exchange(entries, {}));
  }
  recognizer.add(scans, entries);
  EXPECT_EQ(std::ssize(recognizer.entries_of("x")), most);
  EXPECT_EQ(recognizer.size(), most);
  return open_map(file, MapAccess::kRead)->value(kProjectionValue);
}

TEST(PlaceRecognizer, ProjectionDependsOnTheWarmUpOnly) {
  const TempDir folder;
  const auto projection = build(folder / "one by one", 10, 1);
  ASSERT_TRUE(projection);
  for (const int64_t at_once : {4, 8, 16, 40})
    EXPECT_EQ(build(folder / std::to_string(at_once), 10, at_once), projection) << at_once;
  // Another process completes the warm-up of a killed one, also without a scan.
  for (const int64_t added : {10, 24, 40}) {
    const auto file = folder / ("killed at " + std::to_string(added));
    EXPECT_EQ(build(file, 1000, 8, added), std::nullopt);
    EXPECT_EQ(build(file, 10, 8), projection) << added;
  }
}

/// Similarities of neighboring scans identify equal places.
FeatureExtractor coordinates_of_places(double same_place) {
  FeatureExtractor extractor = coordinates();
  extractor.comparison.same_place = same_place;
  const auto telling = [same_place](Projection projection) {
    projection.comparison.same_place = same_place;
    return projection;
  };
  extractor.fit_projection = [telling, inner = extractor.fit_projection](
                                 const Rows& features, std::span<const int64_t> rows) {
    return telling(inner(features, rows));
  };
  extractor.open_projection = [telling, inner = extractor.open_projection](
                                  const std::string& content) { return telling(inner(content)); };
  return extractor;
}

/// Adds scans in batches and closes the map in between; nullopt during the warm-up.
std::optional<std::string> projection_of(const std::vector<int>& numbers, int64_t at_once,
                                         double same_place = 0.999) {
  const TempDir folder;
  const RecognizerOptions options{.warmup = 10};
  for (size_t done = 0; done < numbers.size();) {
    PlaceRecognizer recognizer(coordinates_of_places(same_place), options,
                               map_in(folder / "a.map", options));
    for (int step = 0; step < 2 && done < numbers.size(); ++step) {
      std::vector<Description> scans;
      std::vector<MapEntry> entries;
      for (; done < numbers.size() && std::ssize(scans) < at_once; ++done) {
        scans.push_back(described(recognizer, numbers[done]));
        entries.push_back({.frame = static_cast<int64_t>(done)});
      }
      recognizer.add(scans, entries);
      EXPECT_EQ(recognizer.size(), static_cast<int64_t>(done));
      EXPECT_TRUE(recognizer.query(described(recognizer, numbers[0])));
    }
  }
  return open_map(folder / "a.map", MapAccess::kRead)->value(kProjectionValue);
}

TEST(PlaceRecognizer, WarmUpCountsDistinctPlaces) {
  std::vector<int> once, halts;
  for (int i = 0; i < 10; ++i) {
    once.push_back(i);
    for (int again = 0; again < 1 + i % 3; ++again) halts.push_back(i);
  }
  const auto expected = projection_of(once, 1);
  ASSERT_TRUE(expected);
  for (const int64_t at_once : {1, 2, 7, 40}) EXPECT_EQ(projection_of(halts, at_once), expected);
  halts.pop_back();
  EXPECT_EQ(projection_of(halts, 3), std::nullopt) << "the tenth came once only";
}

/// The memory of warm-up entries is bounded.
TEST(PlaceRecognizer, WarmUpEndsWithFewDistinctPlaces) {
  std::vector<int> standing(49, 3);
  standing[0] = 0;  // equal to its own mean
  EXPECT_EQ(projection_of(standing, 7), std::nullopt);
  standing.push_back(3);
  const auto projection = projection_of(standing, 7);
  ASSERT_TRUE(projection);
  standing.insert(standing.end(), {4, 5, 6});
  EXPECT_EQ(projection_of(standing, 1), projection);
  EXPECT_EQ(projection_of(standing, 60), projection);
}

TEST(PlaceRecognizer, ScoresByDistinctPlaces) {
  EXPECT_EQ(PlaceRecognizer(coordinates(), {}).score(), Score::kMargin);
  EXPECT_EQ(PlaceRecognizer(coordinates(), {.score = Score::kSimilarity}).score(),
            Score::kSimilarity);
  EXPECT_EQ(PlaceRecognizer(coordinates_of_places(0.9), {}).score(), Score::kDistinctMargin);
  const PlaceRecognizer paper(coordinates_of_places(0.9), {.score = Score::kMargin});
  EXPECT_EQ(paper.score(), Score::kMargin);
  // A minute at the same place: the fourth scan looks like the first, but is no distinct place.
  // Neither are skipped or removed entries.
  PlaceRecognizer recognizer(coordinates_of_places(0.99), {.warmup = 10});
  drive(recognizer, 0, 60);
  std::vector<int64_t> same(1, 7);
  for (int i = 0; i < 600; ++i)
    same.push_back(recognizer.add(described(recognizer, 107), {.frame = i}));
  const Description scan = described(recognizer, 207);
  const auto loop = recognizer.query(scan);
  EXPECT_LT(loop->kth_similarity, 0.98);
  EXPECT_EQ(loop->score, 2 * loop->similarity - loop->kth_similarity);
  PlaceRecognizer once(coordinates_of_places(0.99), {.warmup = 10});
  drive(once, 0, 60);
  EXPECT_EQ(once.query(scan)->kth_similarity, loop->kth_similarity);
  EXPECT_EQ(once.query(scan, std::vector<int64_t>{7})->index, recognizer.query(scan, same)->index);
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

/// `from`, `to` and `step` are in [m] along the street.
struct Drive {
  double from = 0, to = 200, step = 0.5;
  bool poses = true;
  std::string name = "d";
  int pass = 0;
  int64_t frame = 0;

  void add(PlaceRecognizer& recognizer, double meters) {
    std::optional<Eigen::Isometry3d> pose;
    if (poses) pose = Eigen::Translation3d(meters, 0, 0) * Eigen::Isometry3d::Identity();
    recognizer.add(seen_at(meters, pass), {.drive = name, .frame = frame++, .pose = pose});
  }
  void add_all(PlaceRecognizer& recognizer) {
    for (double meters = from; meters < to; meters += step) add(recognizer, meters);
  }
};

/// Starts [m] of the stretches of 5 m where most loops are ambiguous.
std::vector<int> ambiguous_meters(const PlaceRecognizer& recognizer) {
  std::vector<int> meters;
  for (int from = 0; from < 200; from += 5) {
    int ambiguous = 0;
    for (int i = 0; i < 10; ++i) {
      const auto loop = recognizer.query(seen_at(from + 0.5 * i + 0.25, 99));
      EXPECT_EQ(loop->accepted, !loop->ambiguous);
      ambiguous += loop->ambiguous ? 1 : 0;
    }
    if (ambiguous > 5) meters.push_back(from);
  }
  return meters;
}

const std::vector<int> kTunnel = {60, 65, 70, 75, 80, 85, 90, 95, 100, 105, 110, 115};
constexpr double kSamePlace = 0.65;
/// Accepts everything except ambiguous loops.
const RecognizerOptions kAcceptsAll = {.warmup = 30, .threshold = -9};

TEST(PlaceRecognizer, AcceptsNoMatchInATunnel) {
  for (const bool poses : {true, false})
    for (const double step : {0.1, 0.5, 1.5, 3.0})  // dense drives and keyframes
      for (const int64_t warmup : {2, 30, 1000}) {
        SCOPED_TRACE(testing::Message() << poses << ' ' << step << ' ' << warmup);
        PlaceRecognizer recognizer(coordinates_of_places(kSamePlace),
                                   {.warmup = warmup, .threshold = -9});
        Drive{.step = step, .poses = poses}.add_all(recognizer);
        EXPECT_EQ(ambiguous_meters(recognizer), kTunnel);
      }
  PlaceRecognizer no_places(coordinates(), kAcceptsAll);
  Drive{}.add_all(no_places);
  EXPECT_TRUE(ambiguous_meters(no_places).empty()) << "similarities do not tell";
}

TEST(PlaceRecognizer, HaltsAndRepeatedStreetsAreNotAmbiguous) {
  for (const bool poses : {true, false}) {
    PlaceRecognizer recognizer(coordinates_of_places(kSamePlace), kAcceptsAll);
    for (int pass = 0; pass < 4; ++pass) {
      Drive street{.from = 120, .to = 150, .poses = poses, .pass = pass, .frame = 10000 * pass};
      street.name = std::to_string(pass % 2);
      street.add_all(recognizer);
      for (int i = 0; i < 300; ++i) {
        street.pass = 100 + i;
        street.add(recognizer, 150);
      }
      street.from = 150;
      street.to = 200;
      street.add_all(recognizer);
    }
    for (double meters = 120.25; meters < 200; meters += 0.5)
      EXPECT_TRUE(recognizer.query(seen_at(meters, 99))->accepted) << poses << ' ' << meters;
  }
}

TEST(PlaceRecognizer, FindsTunnelsInAnyMap) {
  const TempDir folder;
  const FeatureExtractor extractor = coordinates_of_places(kSamePlace);
  const auto open = [&](const char* name) {
    return std::make_unique<PlaceRecognizer>(extractor, kAcceptsAll,
                                             map_in(folder / name, kAcceptsAll));
  };
  const auto answers = [](const PlaceRecognizer& recognizer) {
    std::vector<std::pair<int64_t, bool>> all;
    for (double meters = 0.25; meters < 200; ++meters)
      if (const auto loop = recognizer.query(seen_at(meters, 99)))
        all.emplace_back(loop->index, loop->ambiguous);
    return all;
  };
  // Two robots alternate; the map is closed and opened in between.
  Drive here{.name = "here"}, there{.from = 1000, .to = 1200, .poses = false, .name = "there"};
  auto recognizer = open("two");
  for (int i = 0; i < 200; ++i) {
    here.add(*recognizer, i);
    there.add(*recognizer, 1000 + i);
    if (i % 60 != 59) continue;
    const auto before = answers(*recognizer);
    recognizer.reset();  // a single writer
    recognizer = open("two");
    EXPECT_EQ(answers(*recognizer), before);
  }
  EXPECT_EQ(ambiguous_meters(*recognizer), kTunnel);
  // Blocks of scans described by several machines; some were removed.
  auto blocks = open("blocks");
  for (const int block : {1, 0, 3, 2, 5, 4, 7, 6, 9, 8}) {
    Drive part{.from = 20.0 * block, .to = 20.0 * (block + 1), .frame = int64_t{40} * block};
    part.add_all(*blocks);
  }
  blocks->remove(std::vector<int64_t>{10, 11, 200});
  blocks.reset();
  blocks = open("blocks");
  EXPECT_EQ(ambiguous_meters(*blocks), kTunnel);
}

TEST(PlaceRecognizer, RefreshLoadsEntriesOfOthers) {
  const TempDir folder;
  PlaceRecognizer writer(coordinates(), {.warmup = 10}, map_in(folder / "a.map"));
  drive(writer, 0, 5);
  PlaceRecognizer reader(coordinates(), {.warmup = 10},
                         open_map(folder / "a.map", MapAccess::kRead));
  EXPECT_EQ(reader.size(), 5);
  drive(writer, 5, 50);
  writer.calibrate(0.25);
  EXPECT_EQ(reader.size(), 5);
  reader.refresh();
  EXPECT_EQ(reader.size(), 50);
  EXPECT_EQ(reader.threshold(), 0.25);
  const auto there = best_match(writer, 107);
  const auto here = best_match(reader, 107);
  EXPECT_EQ(here->index, 7);
  EXPECT_EQ(here->similarity, there->similarity);
  EXPECT_TRUE(here->accepted);
}

std::vector<float> coordinates_of(int i) {
  std::vector<float> feature;
  for (const Point& p : scan_of(i).points) feature.insert(feature.end(), {p.x, p.y, p.z});
  return feature;
}

/// A map in a file. One statement can fail, once: the first with `breaks_at`, but for some of its
/// executions or rows.
struct BreakingDriver : SqliteDriver {
  explicit BreakingDriver(const fs::path& file)
      : SqliteDriver(file, SQLITE_OPEN_READWRITE, "the map") {}
  void execute(const std::string& sql, const std::vector<SqlValue>& values,
               const Take& take) override {
    const bool breaks = !breaks_at.empty() && sql.find(breaks_at) != std::string::npos;
    const auto break_off = [&] {
      breaks_at.clear();
      throw Error("lost");
    };
    if (breaks && rows_left < 0 && statements_left-- == 0) break_off();
    SqliteDriver::execute(sql, values, [&](const SqlRow& row) {
      if (breaks && rows_left-- == 0) break_off();
      if (take) take(row);
    });
  }
  std::string breaks_at;
  int statements_left = 0;
  int rows_left = -1;  // below 0: the statement itself fails
};

struct BreakingMap {
  explicit BreakingMap(const FeatureExtractor& extractor, const RecognizerOptions& options = {}) {
    const MapFingerprint fingerprint = PlaceRecognizer::fingerprint_of(extractor, options);
    open_map(folder / "map", MapAccess::kNew, &fingerprint);
    auto with = std::make_unique<BreakingDriver>(folder / "map");
    driver = with.get();
    store = std::make_unique<MapStore>(std::move(with), MapAccess::kWrite);
    map = store.get();
  }
  TempDir folder;
  BreakingDriver* driver;
  std::unique_ptr<MapStore> store;
  MapStore* map;
};

TEST(PlaceRecognizer, RefreshResumesAfterAnError) {
  FeatureExtractor extractor = coordinates();
  extractor.fit_projection = nullptr;
  BreakingMap breaking(extractor);
  PlaceRecognizer recognizer(extractor, {}, std::move(breaking.store));
  const auto other = open_map(breaking.folder / "map", MapAccess::kWrite);
  for (int id = 1; id <= 6; ++id) {
    const MapEntry entry{.descriptor = coordinates_of(id)};
    other->add({&entry, 1});
  }
  breaking.driver->breaks_at = "FROM entry";
  breaking.driver->rows_left = 3;
  expect_error<Error>([&] { recognizer.refresh(); }, {"lost"});
  EXPECT_EQ(recognizer.size(), 3);
  recognizer.refresh_if_updated();
  EXPECT_EQ(recognizer.size(), 6);
  const Description scan = described(recognizer, 105);
  EXPECT_EQ(recognizer.query(scan)->id, 5);
  other->remove(std::vector<int64_t>{5});
  breaking.driver->breaks_at = "checksum FROM removed";
  expect_error<Error>([&] { recognizer.refresh(); }, {"lost"});
  recognizer.refresh_if_updated();
  EXPECT_NE(recognizer.query(scan)->id, 5);
}

TEST(PlaceRecognizer, AddsEntriesIfTheWarmUpCannotEnd) {
  BreakingMap breaking(coordinates(), {.warmup = 3});
  std::vector<std::string> warnings;
  PlaceRecognizer recognizer(coordinates(), {.warmup = 3}, std::move(breaking.store),
                             into(warnings));
  breaking.driver->breaks_at = "UPDATE entry";
  drive(recognizer, 0, 3);
  EXPECT_EQ(breaking.map->size(), 3);
  EXPECT_FALSE(breaking.map->value(kProjectionValue));
  ASSERT_EQ(warnings.size(), 1U);
  EXPECT_HAS(warnings[0], "lost");
  drive(recognizer, 3, 4);
  EXPECT_TRUE(breaking.map->value(kProjectionValue));
  EXPECT_EQ(warnings.size(), 1U);
  EXPECT_EQ(best_match(recognizer, 102)->index, 2);
}

TEST(PlaceRecognizer, RejectsInvalidDescriptions) {
  PlaceRecognizer recognizer(coordinates(), {});
  for (const float number : {3e9F, NAN, -INFINITY}) {
    const Description odd{.feature = {1, 2, 3, 4, 5, number}, .error = ""};
    expect_error<UsageError>([&] { recognizer.add(odd, {}); }, {"not finite, or above 1e9"});
    expect_error<UsageError>([&] { recognizer.query(odd); }, {"not finite, or above 1e9"});
  }
  const Description two{.feature = {1, 2}, .error = ""};
  for (int i = 0; i < 2; ++i) {  // without and with entries
    expect_error<UsageError>([&] { recognizer.query(two); }, {"has 2 dimensions", "has 6"});
    expect_error<UsageError>([&] { recognizer.add(two, {}); }, {"has 2 dimensions", "has 6"});
    recognizer.add(described(recognizer, i), {});
  }
  EXPECT_EQ(recognizer.size(), 2);
}

TEST(PlaceRecognizer, SkipsEntriesOfOtherDimensions) {
  const TempDir folder;
  {
    const auto map = map_in(folder / "a.map");
    MapEntry entry;
    entry.descriptor = {1, 2, 3};
    map->add({&entry, 1});
  }
  std::vector<std::string> problems;
  const auto open = [&] {
    problems.clear();
    return std::make_unique<PlaceRecognizer>(coordinates(), RecognizerOptions{.warmup = 10},
                                             map_in(folder / "a.map"), into(problems));
  };
  auto recognizer = open();
  ASSERT_EQ(problems.size(), 1);
  EXPECT_HAS(problems[0], "entry 1 is skipped: its feature has 0 dimensions, expected 6");
  drive(*recognizer, 0, 30);  // beyond the end of the warm-up
  recognizer.reset();
  recognizer = open();
  ASSERT_EQ(problems.size(), 1);
  EXPECT_HAS(problems[0], "its descriptor has 3 dimensions, expected 6");
  EXPECT_EQ(recognizer->size(), 30);
  EXPECT_EQ(best_match(*recognizer, 107)->id, 9);
}

TEST(PlaceRecognizer, SkipsEntriesWithTooLargeValues) {
  const TempDir folder;
  {
    std::vector<MapEntry> entries(3);
    for (int i = 0; i < 3; ++i) entries[i].feature = entries[i].descriptor = coordinates_of(i);
    entries[1].feature[2] = 3e38F;  // their sum would be infinite
    entries[2].feature[2] = 3e38F;
    map_in(folder / "a.map")->add(entries);
  }
  std::vector<std::string> problems;
  PlaceRecognizer recognizer(coordinates(), {.warmup = 2}, map_in(folder / "a.map"),
                             into(problems));
  ASSERT_EQ(problems.size(), 2);
  EXPECT_HAS(problems[0], "entry 2 is skipped: its feature has numbers that are not finite, or");
  EXPECT_EQ(recognizer.size(), 1);
  PointCloud far = scan_of(0);
  far.points[1].z = 1e10F;
  EXPECT_HAS(recognizer.describe(view_of(far)).error, "its feature has numbers that are not");
}

/// The map can still be opened, in order to calibrate it again.
void expect_ignored_calibration(const fs::path& file, const std::string& problem) {
  std::vector<std::string> warnings;
  PlaceRecognizer recognizer(coordinates(), {}, map_in(file), into(warnings));
  recognizer.refresh();
  EXPECT_FALSE(recognizer.threshold());
  ASSERT_EQ(warnings.size(), 1);
  EXPECT_HAS(warnings[0], problem);
  EXPECT_HAS(warnings[0], "calibrate the map again");
  const std::vector<std::string> found = check_map(file);
  ASSERT_EQ(found.size(), 1);
  EXPECT_HAS(found[0], problem);
  recognizer.calibrate(0.5);
  EXPECT_EQ(recognizer.threshold(), 0.5);
}

TEST(PlaceRecognizer, IgnoresInvalidCalibrationsOfAMap) {
  for (const auto& [name, text, problem] :
       {std::tuple(kThresholdValue, "high", "threshold: expected a number"),
        {kThresholdValue, "0.5 ", "threshold: expected a number"},
        {kThresholdValue, "nan", "threshold: expected a number"},
        {kThresholdValue, "1e999", "threshold: expected a number"},
        {kCalibrationValue, "nonsense", "the map's calibration: not a usable"},
        {kVerifiedCalibrationValue, "nonsense", "calibration of registered loops: not a usable"}}) {
    SCOPED_TRACE(text);
    const TempDir folder;
    map_in(folder / "a.map")->set_value(name, text);
    expect_ignored_calibration(folder / "a.map", problem);
  }
}

TEST(PlaceRecognizer, IgnoresCorruptCalibrationsOfAMap) {
  for (const std::string_view name : kAcceptanceValues) {
    SCOPED_TRACE(name);
    const TempDir folder;
    const fs::path file = folder / "a.map";
    map_in(file)->set_value(std::string(name), "0.75");
    test::execute_sql(file, str("UPDATE value SET bytes = '0.25' WHERE name = '", name, "'"));
    expect_ignored_calibration(file, "the checksum of a value is wrong");
  }
}

TEST(PlaceRecognizer, EstimatesTheProjectionOfABatchOnce) {
  const TempDir folder;
  std::vector<MapEntry> entries(60);
  for (int i = 0; i < 60; ++i) {
    entries[i].feature = coordinates_of(i);
    entries[i].descriptor = entries[i].feature;
  }
  map_in(folder / "a.map")->add(entries);
  int learnt = 0;
  FeatureExtractor counting = coordinates();
  counting.fit_projection = [&, inner = counting.fit_projection](const Rows& features,
                                                                 std::span<const int64_t> rows) {
    ++learnt;
    return inner(features, rows);
  };
  PlaceRecognizer recognizer(counting, {.warmup = 10}, map_in(folder / "a.map"));
  EXPECT_EQ(learnt, 1);
  drive(recognizer, 60, 70);  // completes the warm-up, from its entries alone
  EXPECT_EQ(learnt, 1);
}

TEST(PlaceRecognizer, ExcludesIndicesInAnyOrder) {
  PlaceRecognizer recognizer(coordinates(), {.warmup = 2, .k = 1});
  for (int i = 0; i < 5; ++i) recognizer.add(described(recognizer, i), {.frame = i});
  const Description scan = described(recognizer, 103);
  EXPECT_EQ(recognizer.query(scan, std::vector<int64_t>{9, -4, INT64_MAX, 2, 0})->index, 3);
  EXPECT_EQ(recognizer.query(scan, std::vector<int64_t>{4, 3, 1, 0, 3})->index, 2);
  EXPECT_FALSE(recognizer.query(scan, std::vector<int64_t>{4, 3, 2, 1, 0, INT64_MIN}));
}

TEST(PlaceRecognizer, NeverReturnsRemovedEntries) {
  const TempDir folder;
  for (const int64_t warmup : {int64_t{1000}, int64_t{10}}) {  // during and after the warm-up
    const std::filesystem::path file = folder / std::to_string(warmup);
    auto writer = std::make_unique<PlaceRecognizer>(
        coordinates(), RecognizerOptions{.warmup = warmup}, map_in(file));
    drive(*writer, 0, 60);
    PlaceRecognizer reader(coordinates(), {.warmup = warmup}, open_map(file, MapAccess::kRead));
    const Description scan = described(reader, 107);
    ASSERT_EQ(reader.query(scan)->index, 7);
    EXPECT_EQ(writer->remove(std::vector<int64_t>{7, 30, 7}), 2);
    EXPECT_EQ(writer->remove(std::vector<int64_t>{7}), 0);
    EXPECT_FALSE(writer->entries_of("").contains(70));
    EXPECT_TRUE(writer->entries_of("").contains(80));
    expect_error<UsageError>([&] { writer->remove(std::vector<int64_t>{60}); }, {"index 60"});
    EXPECT_NE(writer->query(scan)->index, 7);
    reader.refresh();
    EXPECT_NE(reader.query(scan)->index, 7);
    // The others keep their indices, and a new entry gets the next one.
    EXPECT_EQ(best_match(reader, 108)->index, 8);
    EXPECT_EQ(writer->size(), 60);
    drive(*writer, 60, 70);
    reader.refresh();
    const PlaceRecognizer* const both[] = {writer.get(), &reader};
    for (const PlaceRecognizer* one : both) EXPECT_EQ(best_match(*one, 165)->index, 65);
    writer->add(described(*writer, 7), {.drive = "later", .frame = 70});
    EXPECT_EQ(writer->query(scan)->drive, "later");
    writer.reset();
    const PlaceRecognizer again(coordinates(), {.warmup = warmup}, map_in(file));
    EXPECT_EQ(again.size(), 69);
    EXPECT_EQ(again.query(scan)->drive, "later");
    EXPECT_EQ(best_match(again, 108)->id, 9);
  }
  PlaceRecognizer nowhere(coordinates(), {.warmup = 2});
  drive(nowhere, 0, 10);
  EXPECT_EQ(nowhere.remove(std::vector<int64_t>{3}), 1);
  EXPECT_NE(best_match(nowhere, 103)->index, 3);
}

TEST(PlaceRecognizer, RejectsInvalidThresholds) {
  expect_error<UsageError>([&] { PlaceRecognizer(coordinates(), {.threshold = NAN}); },
                           {"threshold"});
  PlaceRecognizer recognizer(coordinates(), {});
  expect_error<UsageError>([&] { recognizer.calibrate(INFINITY); }, {"threshold"});
  EXPECT_FALSE(recognizer.threshold());
}

/// Matches with scores below 0.2 are incorrect, from `correct_from` on correct, in between mostly
/// correct.
Calibration some_calibration(double correct_from = 1.1) {
  Calibration calibration;
  calibration.trained_on = "a town";
  calibration.blocks = {{-1, 1000, 0}, {0.2, 1000, 600}, {correct_from, 1000, 1000}};
  return calibration;
}

FeatureExtractor calibrated_coordinates() {
  FeatureExtractor extractor = coordinates();
  extractor.calibration = some_calibration();
  return extractor;
}

TEST(PlaceRecognizer, AcceptsByTheCalibrationOfItsFeature) {
  PlaceRecognizer recognizer(calibrated_coordinates(), {.warmup = 30});
  EXPECT_EQ(recognizer.threshold(), 1.1);
  EXPECT_EQ(PlaceRecognizer(calibrated_coordinates(), {.target_precision = 0.7}).threshold(), 0.2);
  EXPECT_FALSE(PlaceRecognizer(calibrated_coordinates(), {.target_precision = 0.9999}).threshold());
  EXPECT_EQ(PlaceRecognizer(calibrated_coordinates(), {.threshold = 0.3}).threshold(), 0.3);
  drive(recognizer, 0, 100);
  int accepted = 0;
  for (int i = 50; i < 150; ++i) {  // the first half without matches of their own place
    const std::vector<int64_t> without = i < 100 ? std::vector<int64_t>{i} : std::vector<int64_t>{};
    const auto loop = recognizer.query(described(recognizer, i), without);
    EXPECT_EQ(loop->accepted, loop->score >= 1.1);
    EXPECT_EQ(loop->probability,
              std::min(100.0 / 101, some_calibration().probability(loop->score)));
    accepted += loop->accepted ? 1 : 0;
  }
  EXPECT_GT(accepted, 0);
  EXPECT_LT(accepted, 100);
  for (const RecognizerOptions& other :
       {RecognizerOptions{.k = 2}, RecognizerOptions{.score = Score::kSimilarity}}) {
    PlaceRecognizer uncalibrated(calibrated_coordinates(), other);
    drive(uncalibrated, 0, 5);
    EXPECT_FALSE(uncalibrated.threshold());
    EXPECT_FALSE(uncalibrated.calibration());
    EXPECT_FALSE(best_match(uncalibrated, 9)->probability);
    expect_error<UsageError>([&] { uncalibrated.calibrate(some_calibration()); }, {"k = 4"});
  }
  for (const double precision : {0.0, 1.0, -1.0, std::nan("")})
    expect_error<UsageError>(
        [&] { PlaceRecognizer(coordinates(), {.target_precision = precision}); }, {"precision"});
}

TEST(PlaceRecognizer, PrefersTheCalibrationOfTheMap) {
  const TempDir folder;
  const auto opened = [&](const RecognizerOptions& options = {}) {
    return PlaceRecognizer(calibrated_coordinates(), options, map_in(folder / "a.map"));
  };
  const Calibration own = some_calibration(1.2);
  {
    PlaceRecognizer recognizer = opened();
    EXPECT_EQ(recognizer.threshold(), 1.1);
    recognizer.calibrate(own);
    EXPECT_EQ(recognizer.threshold(), 1.2);
  }
  {
    PlaceRecognizer again = opened();
    EXPECT_EQ(again.threshold(), 1.2);
    EXPECT_EQ(again.calibration(), own);
    again.calibrate(0.4);
    EXPECT_EQ(again.threshold(), 0.4);
  }
  {
    PlaceRecognizer bare = opened();
    EXPECT_EQ(bare.threshold(), 0.4);
    EXPECT_EQ(bare.calibration(), some_calibration()) << "then of the feature";
    bare.calibrate(own);
  }
  EXPECT_EQ(opened().threshold(), 1.2) << "the threshold was replaced";
  EXPECT_EQ(opened({.threshold = 0.1}).threshold(), 0.1);
  EXPECT_EQ(opened({.target_precision = 0.7}).threshold(), 0.2);
}

TEST(PlaceRecognizer, IgnoresCalibrationsForOtherScores) {
  const TempDir folder;
  FeatureExtractor extractor = coordinates_of_places(0.9);
  extractor.calibration = some_calibration();
  extractor.calibration->score = Score::kDistinctMargin;
  std::vector<std::string> warnings;
  const auto opened = [&](std::optional<Score> score) {
    warnings.clear();
    return PlaceRecognizer(extractor, {.score = score}, map_in(folder / "a.map"), into(warnings));
  };
  const Calibration old = some_calibration(1.2);
  opened(Score::kMargin).calibrate(old);
  EXPECT_EQ(opened(Score::kMargin).threshold(), 1.2);
  EXPECT_TRUE(warnings.empty());
  {
    PlaceRecognizer recognizer = opened(std::nullopt);
    EXPECT_EQ(recognizer.threshold(), 1.1) << "its feature's";
    recognizer.refresh();
    ASSERT_EQ(warnings.size(), 1U);
    EXPECT_NE(warnings[0].find("distinct-margin"), std::string::npos) << warnings[0];
    recognizer.calibrate(0.4);
  }
  EXPECT_EQ(opened(std::nullopt).threshold(), 0.4);
  EXPECT_TRUE(warnings.empty());
  EXPECT_FALSE(opened(Score::kMargin).threshold());
  EXPECT_EQ(warnings.size(), 1U);
  opened(Score::kMargin).calibrate(0.5);
  EXPECT_EQ(opened(Score::kMargin).threshold(), 0.5);
  EXPECT_EQ(opened(std::nullopt).threshold(), 1.1);
}

TEST(PlaceRecognizer, KeepsCalibrationsInTheMap) {
  const Calibration own = some_calibration(1.2);
  const TempDir folder;
  for (const bool kept : {true, false}) {
    SCOPED_TRACE(kept);
    PlaceRecognizer recognizer(calibrated_coordinates(), {},
                               kept ? map_in(folder / "a.map") : nullptr);
    const auto expect = [&](double threshold, const Calibration& calibration) {
      for (int i = 0; i < 2; ++i) {
        EXPECT_EQ(recognizer.threshold(), threshold);
        EXPECT_EQ(recognizer.calibration(), calibration);
        recognizer.refresh();
      }
    };
    recognizer.calibrate(own);
    expect(1.2, own);
    recognizer.calibrate(1.0 / 3);
    expect(1.0 / 3, some_calibration());
    expect_error<UsageError>([&] { recognizer.calibrate(Calibration{}); }, {"no blocks"});
    expect(1.0 / 3, some_calibration());
  }
  PlaceRecognizer chosen(calibrated_coordinates(), {.threshold = 0.1}, map_in(folder / "a.map"));
  chosen.calibrate(own);
  EXPECT_EQ(chosen.threshold(), 0.1);
}

TEST(PlaceRecognizer, DropsTheThresholdBeforeACalibrationIsStored) {
  BreakingMap breaking(calibrated_coordinates());
  PlaceRecognizer recognizer(calibrated_coordinates(), {}, std::move(breaking.store));
  const Calibration own = some_calibration(1.2);
  const auto break_off = [&](const auto& calibration) {
    breaking.driver->breaks_at = "INSERT INTO value";
    breaking.driver->statements_left = 1;
    expect_error<Error>([&] { recognizer.calibrate(calibration); }, {"lost"});
    recognizer.refresh();
  };
  recognizer.calibrate(0.4);
  break_off(own);
  EXPECT_EQ(recognizer.threshold(), 1.1);
  recognizer.calibrate(own);
  break_off(0.4);
  EXPECT_EQ(recognizer.threshold(), 0.4);
}

TEST(PlaceRecognizer, ReportsScansThatCannotBeDescribed) {
  PlaceRecognizer recognizer(coordinates(), {});
  const Description none = recognizer.describe({});
  EXPECT_FALSE(none.described());
  EXPECT_EQ(none.error, "the scan has no points");
  PointCloud one;
  one.points.push_back({1, 2, 3, 0});
  EXPECT_EQ(recognizer.describe(view_of(one)).error, "fewer than two points");
  EXPECT_FALSE(recognizer.query(none));
  expect_error<UsageError>([&] { recognizer.add(none, {}); }, {"not described", "no points"});
  EXPECT_EQ(recognizer.size(), 0);
}

TEST(PlaceRecognizer, MakesTheFeatureFunctionOnce) {
  FeatureExtractor extractor = coordinates();
  int made = 0;
  extractor.make = [&, make = std::get<FeatureMaker<PointCloud>>(extractor.make)] {
    ++made;
    return make();
  };
  const PlaceRecognizer recognizer(extractor, {});
  for (int i = 0; i < 3; ++i) described(recognizer, i);
  EXPECT_EQ(made, 1);
}

TEST(PlaceRecognizer, RejectsMapsOfOtherFeatures) {
  const TempDir folder;
  { PlaceRecognizer recognizer(coordinates(), {}, map_in(folder / "a.map")); }
  expect_error<InputError>([&] { map_in(folder / "a.map", {.align = AlignCase::kOne}); },
                           {"alignment", "case1", "none"});
  FeatureExtractor other = coordinates();
  other.key = "coordinates 2";
  // The map was opened without a fingerprint.
  auto map = open_map(folder / "a.map", MapAccess::kRead);
  expect_error<InputError>([&] { PlaceRecognizer(other, {}, std::move(map)); },
                           {"coordinates 1", "coordinates 2"});
  EXPECT_TRUE(map) << "it stays with the caller";
  FeatureExtractor camera = coordinates();
  camera.make = FeatureMaker<GrayImage>();
  expect_error<UsageError>([&] { PlaceRecognizer(camera, {}); }, {"camera images"});
  expect_error<UsageError>([&] { PlaceRecognizer(coordinates(), {.warmup = 1}); },
                           {"warm-up", "found 1"});
  expect_error<UsageError>([&] { PlaceRecognizer(coordinates(), {.k = 0}); }, {"k:", "found 0"});
}

TEST(PlaceRecognizer, ComparesHnswCandidatesExactly) {
#ifndef REVISIT_HAVE_FAISS
  expect_error<UsageError>([] { PlaceRecognizer(coordinates(), {.hnsw_candidates = 30}); },
                           {"candidates of a large map", "FAISS"});
  GTEST_SKIP() << "built without FAISS";
#endif
  const TempDir dir;
  const RecognizerOptions with{.warmup = 20, .hnsw_candidates = 30};
  RecognizerOptions without = with;
  without.hnsw_candidates = 0;
  PlaceRecognizer all(coordinates(), without);
  {
    PlaceRecognizer graph(coordinates(), with, map_in(dir / "map"));
    for (int i = 0; i < 300; ++i)
      for (PlaceRecognizer* recognizer : {&all, &graph})
        recognizer->add(described(*recognizer, i), {.frame = i});
  }
  const PlaceRecognizer graph(coordinates(), with, map_in(dir / "map"));
  int same = 0;
  for (int i = 300; i < 400; ++i) {
    const auto a = best_match(all, i), b = best_match(graph, i);
    same += a->index == b->index && a->score == b->score ? 1 : 0;
  }
  EXPECT_GE(same, 98);
  expect_error<UsageError>([] { PlaceRecognizer(coordinates(), {.hnsw_candidates = -1}); },
                           {"HNSW candidates"});
  FeatureExtractor rings = coordinates();
  rings.comparison = ring_comparison({});
  expect_error<UsageError>([&] { PlaceRecognizer(rings, {.hnsw_candidates = 30}); },
                           {"HNSW candidates", "cosine", rings.name});
  PlaceRecognizer(rings, {});
}

TEST(PlaceRecognizer, IsThreadSafe) {
  PlaceRecognizer recognizer(coordinates(), {.warmup = 30});
  drive(recognizer, 0, 100);
  std::vector<std::thread> threads;
  std::atomic<int> right = 0;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      for (int i = t; i < 100; i += 4) {
        const Description scan = described(recognizer, 100 + i);
        const auto loop = recognizer.query(scan);
        right += loop->frame % 1000 == 10 * i;
        recognizer.add(scan, {.frame = 1000 + 10 * i});
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(right, 100);
  EXPECT_EQ(recognizer.size(), 200);
}

}  // namespace
}  // namespace revisit
