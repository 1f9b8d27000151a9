#include "revisit/recognition/place_index.h"

#include <sys/resource.h>
#include <unistd.h>

#include <Eigen/Core>

#include "float_matrix.h"
#include "revisit/recognition/matrix.h"
#include "revisit/recognition/point_cloud.h"
#include "revisit/recognition/ring/descriptor.h"
#include "testing.h"

namespace revisit {
namespace {

/// Some descriptors are equal, so that ties occur.
FloatMatrix random_descriptors(int64_t n, int64_t d) {
  FloatMatrix all(n, d);
  std::mt19937 random(3);
  std::normal_distribution<float> gaussian;
  for (float& value : all.values) value = gaussian(random);
  for (int64_t i = 7; i < n; i += 100) std::ranges::copy(all.row(3), all.row(i).begin());
  return all;
}

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr int64_t kQueryStep = 130;  // the reference would take minutes otherwise
#else
constexpr int64_t kQueryStep = 13;
#endif

std::vector<std::pair<int64_t, CandidateRange>> past_of(int64_t n) {
  std::vector<std::pair<int64_t, CandidateRange>> queries;
  for (int64_t q = 60; q < n; q += kQueryStep) queries.emplace_back(q, CandidateRange{0, q - 50});
  return queries;
}

std::vector<int64_t> chosen_by_codes(const FloatMatrix& all, int64_t query, int64_t n,
                                     const Comparison& comparison) {
  const std::unique_ptr<CandidateSource> keys = comparison.make_codes();
  for (int64_t i = 0; i < n; ++i) keys->add(all.row(i));
  const CandidateRange among{0, n};
  std::vector<int64_t> places;
  keys->find(all.row(query), {&among, 1}, comparison.candidates, 1, places);
  std::ranges::sort(places);
  return places;
}

double similarity_of(const FloatMatrix& all, int64_t a, int64_t b, const Comparison& comparison) {
  if (!comparison.similarity)
    return cosine(all.row(a), length_of(all.row(a)), all.row(b), length_of(all.row(b)));
  double similarity = 0;
  const std::span<const float> place = all.row(b);
  comparison.similarity(all.row(a), {&place, 1}, {&similarity, 1});
  return similarity;
}

/// Keeps the places from which kDistinctMargin is computed.
void keep_distinct(std::vector<std::pair<double, int64_t>>& ranked, const FloatMatrix& all,
                   const Comparison& comparison, int k) {
  ranked.resize(std::min<size_t>(ranked.size(), kMaxExamined));
  std::vector<std::pair<double, int64_t>> distinct;
  for (const auto& place : ranked)
    if (std::ranges::none_of(distinct, [&](const auto& other) {
          return similarity_of(all, place.second, other.second, comparison) >=
                 *comparison.same_place;
        }))
      distinct.push_back(place);
  if (std::ssize(distinct) < k && distinct.back() != ranked.back())
    distinct.push_back(ranked.back());
  ranked = distinct;
}

/// Reference for best(): compares the first `n` places (or those selected by codes) and sorts them.
Match slow_twin(const FloatMatrix& all, int64_t query, int64_t n, const Comparison& comparison,
                const SearchOptions& options) {
  std::vector<int64_t> places(static_cast<size_t>(n));
  std::iota(places.begin(), places.end(), 0);
  if (comparison.candidates > 0) places = chosen_by_codes(all, query, n, comparison);
  std::vector<double> similarities(places.size());
  if (comparison.similarity)
    comparison.similarity(all.row(query), test::rows_of(all, places), similarities);
  else
    for (size_t i = 0; i < places.size(); ++i)
      similarities[i] = cosine(all.row(query), length_of(all.row(query)), all.row(places[i]),
                               length_of(all.row(places[i])));
  std::vector<std::pair<double, int64_t>> ranked;
  for (size_t i = 0; i < places.size(); ++i) ranked.emplace_back(-similarities[i], places[i]);
  std::ranges::sort(ranked);
  if (options.score == Score::kDistinctMargin) keep_distinct(ranked, all, comparison, options.k);
  ranked.resize(std::min(ranked.size(), static_cast<size_t>(options.k)));
  Match match;
  for (const auto& [similarity, place] : ranked) {
    match.ranks.push_back(place);
    match.similarities.push_back(-similarity);
  }
  const double best = match.similarities.front(), kth = match.similarities.back();
  match.score = options.score == Score::kSimilarity ? best : 2 * best - kth;
  return match;
}

void expect_same(const Match& a, const Match& b) {
  EXPECT_EQ(a.ranks, b.ranks);
  EXPECT_EQ(a.similarities, b.similarities);
  EXPECT_EQ(a.score, b.score);
}

PlaceIndex index_of(const FloatMatrix& all, const Comparison& comparison = {}) {
  PlaceIndex index(all.d, comparison);
  for (int64_t i = 0; i < all.n; ++i) index.add(all.row(i));
  return index;
}

/// Tests single queries and batches.
void expect_what_the_slow_twin_finds(const FloatMatrix& all, const Comparison& comparison,
                                     const SearchOptions& options) {
  const PlaceIndex index = index_of(all, comparison);
  const auto queries = past_of(all.n);
  std::vector<Query> together;
  for (const auto& [place, candidates] : queries)
    together.push_back({all.row(place), {&candidates, 1}});
  const std::vector<Match> many = index.best_of_many(together, options);
  for (size_t q = 0; q < queries.size(); ++q) {
    SCOPED_TRACE(q);
    const auto& [place, candidates] = queries[q];
    const Match expected = slow_twin(all, place, candidates.end, comparison, options);
    expect_same(index.best(all.row(place), {&candidates, 1}, options), expected);
    expect_same(many[q], expected);
    EXPECT_EQ(many[q].query, static_cast<int64_t>(q));
  }
}

struct AllCosines : CandidateSource {
  FloatMatrix descriptors;
  mutable int64_t asked = 0;
  int64_t size() const override { return descriptors.n; }
  void add(std::span<const float> descriptor) override {
    descriptors.d = static_cast<int64_t>(descriptor.size());
    descriptors.values.insert(descriptors.values.end(), descriptor.begin(), descriptor.end());
    ++descriptors.n;
  }
  void find(std::span<const float> query, std::span<const CandidateRange> among, int64_t count, int,
            std::vector<int64_t>& places) const override {
    asked = count;
    places.clear();
    for (const CandidateRange& range : among)
      for (int64_t place = range.begin; place < range.end; ++place) places.push_back(place);
    std::ranges::stable_sort(places, std::greater(), [&](int64_t i) {
      return cosine(query, length_of(query), descriptors.row(i), length_of(descriptors.row(i)));
    });
    places.resize(std::min(places.size(), static_cast<size_t>(count)));
    std::ranges::reverse(places);
  }
};

std::unique_ptr<AllCosines> source_of(const PlaceIndex& index) {
  auto source = std::make_unique<AllCosines>();
  for (int64_t i = 0; i < index.size(); ++i) source->add(index.descriptor(i));
  return source;
}

TEST(PlaceIndex, EqualsTheReferenceByCosine) {
  expect_what_the_slow_twin_finds(random_descriptors(2500, 37), {}, {.k = 4});
  expect_what_the_slow_twin_finds(random_descriptors(1024, 37), {},
                                  {.k = 1, .score = Score::kSimilarity});
}

TEST(PlaceIndex, EqualsTheReferenceByRings) {
  const RingLayout layout{3, 2, 5, 1};
  const FloatMatrix all = random_descriptors(1300, dim_of(layout));
  for (const int64_t candidates : {0, 1300, 60})
    expect_what_the_slow_twin_finds(all, ring_comparison(layout, candidates), {.k = 4});
}

TEST(PlaceIndex, EqualsTheReferenceAmongDistinctPlaces) {
  const RingLayout layout{3, 2, 5, 1};
  const FloatMatrix all = random_descriptors(1300, dim_of(layout));
  for (Comparison comparison : {Comparison(), ring_comparison(layout), ring_comparison(layout, 60)})
    for (const double same_place : {0.05, 0.3, 4.0}) {
      SCOPED_TRACE(same_place);
      comparison.same_place = same_place * (comparison.similarity ? 20 : 1);  // not unit vectors
      expect_what_the_slow_twin_finds(all, comparison, {.k = 4, .score = Score::kDistinctMargin});
    }
  PlaceIndex index = index_of(all);
  const CandidateRange some{0, 100};
  expect_error<UsageError>(
      [&] {
        index.best(all.row(200), {&some, 1}, {.score = Score::kDistinctMargin});
      },
      {"distinct-margin"});
}

/// Maps have every place once, or ten times with little noise.
TEST(PlaceIndex, TheDistinctMarginDoesNotDependOnHowDenselyPlacesAreStored) {
  const RingLayout layout{20, 15, 15, 15};
  std::mt19937 random(7);
  std::normal_distribution<float> gaussian;
  const auto noisy = [&](std::vector<float> x, float share) {
    const auto deviation = share / std::sqrt(static_cast<float>(x.size()));
    for (float& value : x) value += deviation * gaussian(random);
    const auto length = static_cast<float>(length_of(x));
    for (float& value : x) value /= length;
    return x;
  };
  const std::vector<float> nothing(static_cast<size_t>(dim_of(layout)));
  PlaceIndex sparse(dim_of(layout), ring_comparison(layout)),
      dense(dim_of(layout), ring_comparison(layout));
  std::vector<std::vector<float>> places;
  for (int i = 0; i < 50; ++i) sparse.add(places.emplace_back(noisy(nothing, 1)));
  for (int i = 0; i < 500; ++i) dense.add(noisy(places[static_cast<size_t>(i) / 10], 0.2F));
  const std::vector<float> query = noisy(places[7], 0.6F);
  const auto score = [&](const PlaceIndex& index, Score by) {
    const CandidateRange all{0, index.size()};
    return index.best(query, {&all, 1}, {.score = by}).score;
  };
  EXPECT_NEAR(score(dense, Score::kDistinctMargin), score(sparse, Score::kDistinctMargin), 0.1);
  EXPECT_LT(score(dense, Score::kMargin), score(sparse, Score::kMargin) - 0.3);
}

TEST(PlaceIndex, MayReferToDescriptorsOfTheCaller) {
  const FloatMatrix all = random_descriptors(2500, 37);
  std::vector<Query> queries;
  const CandidateRange some{10, 1200};
  for (int64_t q = 0; q < 40; ++q) queries.push_back({all.row(q), {&some, 1}});
  for (const int64_t step : {1, 2}) {  // contiguous in memory, and with gaps
    PlaceIndex copies(37), references(37);
    for (int64_t i = 0; i < all.n; i += step) {
      copies.add(all.row(i));
      references.add_view(all.row(i));
    }
    references.add(all.row(3));
    EXPECT_TRUE(std::ranges::equal(references.descriptor(20), all.row(20 * step)));
    const std::vector<Match> found = references.best_of_many(queries, {.threads = 2}),
                             expected = copies.best_of_many(queries);
    for (size_t q = 0; q < queries.size(); ++q) expect_same(found[q], expected[q]);
  }
}

/// Without a file, the index keeps its copies in memory and gives the same results.
TEST(PlaceIndex, CopiesAreInAFileWhereItCanBeWritten) {
  const RingLayout layout{16, 8, 8};
  FloatMatrix all = random_descriptors(2500, dim_of(layout));
  for (int64_t i = 0; i < all.n; ++i) {
    const auto length = static_cast<float>(length_of(all.row(i)));
    for (float& value : all.row(i)) value /= length;
  }
  const Comparison comparison = ring_comparison(layout, 300);
  PlaceIndex references(all.d, comparison), in_file(all.d, comparison),
      in_memory(all.d, comparison);
  const auto add_all = [&](PlaceIndex& index) {
    for (int64_t i = 0; i < all.n; ++i) index.add(all.row(i));
  };
  for (int64_t i = 0; i < all.n; ++i) references.add_view(all.row(i));
  add_all(in_file);
  const auto handler = ::signal(SIGXFSZ, SIG_IGN);  // write() returns EFBIG instead
  rlimit files{};
  ::getrlimit(RLIMIT_FSIZE, &files);
  const rlimit none{0, files.rlim_max};
  ::setrlimit(RLIMIT_FSIZE, &none);
  add_all(in_memory);
  ::setrlimit(RLIMIT_FSIZE, &files);
  ::signal(SIGXFSZ, handler);
  const std::vector<CandidateRange> some = {{3, 900}, {1000, 1100}, {1500, 2400}};
  const SearchOptions options{.score = Score::kDistinctMargin};
  for (int64_t q = 0; q < all.n; q += 50) {
    EXPECT_TRUE(std::ranges::equal(in_file.descriptor(q), all.row(q)));
    const Match expected = references.best(all.row(q), some, options);
    expect_same(in_file.best(all.row(q), some, options), expected);
    expect_same(in_memory.best(all.row(q), some, options), expected);
  }
}

TEST(PlaceIndex, CopiesTakeNoMemory) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "sanitizers keep freed memory";
#endif
  const auto resident_pages = [] {
    std::ifstream statm("/proc/self/statm");
    int64_t size = 0, resident = 0;
    statm >> size >> resident;
    return resident;
  };
  constexpr int64_t kPlaces = 12'000;  // 48 MB
  const RingLayout layout{500, 250};
  PlaceIndex index(dim_of(layout), ring_comparison(layout, 100));
  const std::vector<float> descriptor(static_cast<size_t>(dim_of(layout)), 0.01F);
  const int64_t before = resident_pages();
  for (int64_t i = 0; i < kPlaces; ++i) index.add(descriptor);
  EXPECT_LT((resident_pages() - before) * ::sysconf(_SC_PAGESIZE), 16'000'000);
}

TEST(PlaceIndex, ASimilarityIsToldAllCandidatesInOneCall) {
  Comparison shares;  // normalized over all candidates, like a probability
  shares.similarity = [](std::span<const float>, std::span<const std::span<const float>> places,
                         std::span<double> similarities) {
    std::ranges::fill(similarities, 1 / static_cast<double>(places.size()));
  };
  const PlaceIndex index = index_of(random_descriptors(3000, 2), shares);
  const std::vector<CandidateRange> candidates = {{0, 1500}, {1600, 2700}};
  const Match match = index.best(index.descriptor(7), candidates, {.k = 1, .threads = 3});
  EXPECT_EQ(match.similarities, std::vector<double>{1.0 / 2600});
}

TEST(PlaceIndex, NamesASimilarityThatIsNone) {
  Comparison wrong;
  wrong.similarity = [](auto, auto, std::span<double> similarities) {
    std::ranges::fill(similarities, 1);
    if (similarities.size() > 5) similarities[5] = std::nan("");
  };
  const FloatMatrix all = random_descriptors(9, 2);
  const PlaceIndex index = index_of(all, wrong);
  const CandidateRange few{0, 3}, some{1, 9};
  const std::vector<Query> queries = {{all.row(0), {&few, 1}}, {all.row(1), {&some, 1}}};
  expect_error<Error>([&] { index.best_of_many(queries); }, {"query 1 to entry 6 is not finite"});
}

TEST(PlaceIndex, AnswersToManyCanBeStopped) {
  const PlaceIndex index = index_of(random_descriptors(20, 3));
  const CandidateRange all{0, 20};
  const std::vector<float> asked = index.descriptor(0);
  const std::vector<Query> queries(70, Query{asked, {&all, 1}});
  expect_error<Interrupted>([&] { index.best_of_many(queries, {.stop = [] { return true; }}); },
                            {"stopped"});
  int64_t last = 0, total = 0;
  index.best_of_many(queries, {.progress = [&](int64_t done, int64_t of) {
                       EXPECT_GT(done, last);
                       last = done, total = of;
                     }});
  EXPECT_EQ(last, 70);
  EXPECT_EQ(total, 70);
}

TEST(PlaceIndex, RangesMayBeginAndEndAnywhere) {
  const FloatMatrix all = random_descriptors(4100, 19);
  const PlaceIndex index = index_of(all);
  const std::vector<CandidateRange> candidates = {{-5, 3},      {3, 4},       {9, 9},
                                                  {1000, 2049}, {3071, 3073}, {4099, 9999}};
  std::vector<std::pair<double, int64_t>> expected;
  for (int64_t i = 0; i < all.n; ++i)
    if (std::ranges::any_of(candidates, [i](auto r) { return i >= r.begin && i < r.end; }))
      expected.emplace_back(
          -cosine(all.row(3), length_of(all.row(3)), all.row(i), length_of(all.row(i))), i);
  std::ranges::sort(expected);
  const int k = static_cast<int>(expected.size()) + 1;
  for (const int threads : {1, 2, 7}) {
    const Match found = index.best(all.row(3), candidates, {.k = k, .threads = threads});
    ASSERT_EQ(found.ranks.size(), expected.size());
    for (size_t i = 0; i < expected.size(); ++i) {
      EXPECT_EQ(found.ranks[i], expected[i].second);
      EXPECT_EQ(found.similarities[i], -expected[i].first);
    }
  }
}

TEST(PlaceIndex, ThreadsAndManyAtOnceGiveTheSame) {
  const RingLayout layout{3, 2, 5, 1};
  const FloatMatrix all = random_descriptors(5000, dim_of(layout));
  const std::vector<CandidateRange> candidates = {{0, 2500}, {2600, 4990}};
  std::vector<Query> queries;
  for (int64_t q = 0; q < 130; ++q) queries.push_back({all.row(q), candidates});
  for (const Comparison& comparison :
       {Comparison(), ring_comparison(layout), ring_comparison(layout, 40)}) {
    const PlaceIndex index = index_of(all, comparison);
    const std::vector<Match> many = index.best_of_many(queries, {.threads = 3});
    ASSERT_EQ(many.size(), 130);
    for (size_t q = 0; q < queries.size(); ++q) {
      const Match one = index.best(queries[q].descriptor, candidates);
      expect_same(index.best(queries[q].descriptor, candidates, {.threads = 4}), one);
      expect_same(many[q], one);
      EXPECT_EQ(many[q].relative_yaw, one.relative_yaw);
      EXPECT_EQ(one.relative_yaw.has_value(), bool(comparison.relative_yaw));
    }
  }
}

TEST(PlaceIndex, LosesNothingToTheSizeOfNumbers) {
  FloatMatrix all = random_descriptors(1500, 16);
  for (int64_t i = 0; i < all.n; ++i)
    for (float& v : all.row(i)) v *= i % 3 == 0 ? 1e-30F : i % 3 == 1 ? 1e30F : 1;
  std::ranges::fill(all.row(5), 0.0F);
  expect_what_the_slow_twin_finds(all, {}, {.k = 6});
}

TEST(PlaceIndex, ComparesCandidatesOfASource) {
  const FloatMatrix all = random_descriptors(1500, 20);
  const std::vector<CandidateRange> candidates = {{0, 700}, {710, 1500}};
  std::vector<Query> queries;
  for (int64_t q = 0; q < 200; ++q) queries.push_back({all.row(q), candidates});
  const PlaceIndex exact = index_of(all);
  PlaceIndex index = index_of(all);
  auto source = source_of(index);
  const AllCosines& asked = *source;
  index.set_candidate_source(std::move(source), 60);
  const std::vector<Match> many = index.best_of_many(queries);
  EXPECT_EQ(asked.asked, 60);
  for (size_t q = 0; q < queries.size(); ++q) {
    const Match expected = exact.best(queries[q].descriptor, candidates);
    expect_same(index.best(queries[q].descriptor, candidates, {.threads = 2}), expected);
    expect_same(many[q], expected);
  }
  index.add(all.row(0));
  EXPECT_EQ(asked.size(), 1501);
}

struct OnlyPlaceThree : CandidateSource {
  int64_t size() const override { return 1500; }
  void add(std::span<const float>) override {}
  void find(std::span<const float>, std::span<const CandidateRange>, int64_t, int,
            std::vector<int64_t>& places) const override {
    places.assign({3});
  }
};

TEST(PlaceIndex, SearchesAllWhereASourceFindsTooFew) {
  const RingLayout layout{3, 2, 5, 1};
  const FloatMatrix all = random_descriptors(1500, dim_of(layout));
  const CandidateRange candidates{0, 1500}, third{3, 4};
  for (const Comparison& comparison : {Comparison(), ring_comparison(layout)}) {
    PlaceIndex index = index_of(all, comparison);
    const Match expected = index.best(all.row(8), {&candidates, 1}),
                best = index.best(all.row(8), {&candidates, 1}, {.k = 1});
    index.set_candidate_source(std::make_unique<OnlyPlaceThree>(), 10);
    expect_same(index.best(all.row(8), {&candidates, 1}), expected);
    EXPECT_EQ(index.best(all.row(8), {&third, 1}).ranks, std::vector<int64_t>{3});
    // One place suffices for the request.
    EXPECT_EQ(index.best(all.row(8), {&candidates, 1}, {.k = 1}).ranks, std::vector<int64_t>{3});
    EXPECT_NE(best.ranks, std::vector<int64_t>{3});
    index.set_candidate_source(std::make_unique<OnlyPlaceThree>(), 1);
    EXPECT_EQ(index.best(all.row(8), {&candidates, 1}, {.k = 1}).ranks, std::vector<int64_t>{3});
  }
}

TEST(PlaceIndex, RefusesASourceOfOtherPlaces) {
  PlaceIndex index(2);
  expect_error<UsageError>(
      [&] { index.set_candidate_source(std::make_unique<OnlyPlaceThree>(), 5); },
      {"source of 0 places", "1500"});
  expect_error<UsageError>([&] { index.set_candidate_source(std::make_unique<AllCosines>(), 0); },
                           {"at least 1 candidate"});
}

TEST(PlaceIndex, OfNothingFindsNothing) {
  PlaceIndex index(2);
  const std::vector<float> x{1, 2};
  const CandidateRange all{0, 100}, none{5, 5};
  EXPECT_TRUE(index.best(x, {&all, 1}).ranks.empty());
  index.add(x);
  EXPECT_TRUE(index.best(x, {&none, 1}).ranks.empty());
  EXPECT_TRUE(index.best(x, {}).ranks.empty());
  EXPECT_EQ(index.best(x, {&all, 1}).ranks, std::vector<int64_t>{0});
  EXPECT_DOUBLE_EQ(index.best(x, {&all, 1}).similarities[0], 1);
}

TEST(PlaceIndex, RejectsInvalidDescriptors) {
  PlaceIndex index(2);
  expect_error<UsageError>([&] { index.add(std::vector<float>{1, 2, 3}); }, {"2 values", "3"});
  expect_error<UsageError>(
      [&] {
        index.add(std::vector<float>{1, std::numeric_limits<float>::quiet_NaN()});
      },
      {"not finite"});
  const std::vector<float> x{1, 2, 3};
  expect_error<UsageError>([&] { index.add_view(x); }, {"2 values", "3"});
  EXPECT_EQ(index.size(), 0);
  const CandidateRange all{0, 1};
  expect_error<UsageError>([&] { index.best(x, {&all, 1}); }, {"query of 2 values", "3"});
  const std::span<const float> two = std::span(x).first(2);
  expect_error<UsageError>([&] { index.best(two, {&all, 1}, {.k = 0}); }, {"k:", "found 0"});
  expect_error<UsageError>(
      [&] {
        index.best(two, {&all, 1}, {.threads = 0});
      },
      {"threads:", "found 0"});
}

TEST(Points, AreTakenWhereTheyLie) {
  struct Other {  // as a driver packs them
    char pad;
    float z;
    double time;
    float x, y;
  } __attribute__((packed));
  const Other packed[] = {{0, 3, 0, 1, 2}, {0, 6, 0, 4, 5}};
  PointCloud cloud;
  copy_points(
      {packed, 2, sizeof(Other), offsetof(Other, x), offsetof(Other, y), offsetof(Other, z)},
      cloud);
  ASSERT_EQ(cloud.points.size(), 2);
  EXPECT_EQ(cloud.points[1].x, 4);
  EXPECT_EQ(cloud.points[1].y, 5);
  EXPECT_EQ(cloud.points[1].z, 6);
  const Eigen::Matrix3Xf columns = Eigen::Matrix3Xf::Random(3, 5);
  copy_points({columns.data(), 5, 3 * sizeof(float)}, cloud);
  EXPECT_EQ(cloud.points[4].z, columns(2, 4));
  const std::vector<Eigen::Vector3d> doubles = {{1, 2, 3}, {4, 5, 6.5}};
  copy_points(view_of(doubles), cloud);
  EXPECT_EQ(cloud.points[1].x, 4);
  EXPECT_EQ(cloud.points[1].z, 6.5);
  expect_error<UsageError>(
      [&] {
        copy_points({doubles.data(), 2, 24, 0, 8, 20, true}, cloud);
      },
      {"stride", "28", "24"});
  expect_error<UsageError>([&] { copy_points({packed, 2, 8}, cloud); }, {"stride", "12", "8"});
  expect_error<UsageError>([&] { copy_points({nullptr, 2}, cloud); }, {"2 points without data"});
  copy_points({}, cloud);
  EXPECT_TRUE(cloud.points.empty());
}

}  // namespace
}  // namespace revisit
