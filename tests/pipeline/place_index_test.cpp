#include "revisit/recognition/place_index.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <limits>
#include <random>

#include "expect_error.h"
#include "revisit/recognition/cosine.h"
#include "revisit/recognition/points.h"
#include "revisit/recognition/ring/match.h"

namespace revisit::pipeline {
namespace {

using test::expect_error;

/// More than two of the index's blocks, some of them equal, so that ties are there.
FloatMatrix random_descriptors(int64_t n, int64_t d) {
  FloatMatrix all(n, d);
  std::mt19937 random(3);
  std::normal_distribution<float> gaussian;
  for (float& value : all.values) value = gaussian(random);
  for (int64_t i = 7; i < n; i += 100) std::ranges::copy(all.row(3), all.row(i).begin());
  return all;
}

/// Every query after the 60th, among all but the 50 before it.
RetrievalTask past_of(int64_t n) {
  RetrievalTask task;
  for (int64_t i = 0; i < n; ++i) task.stored.push_back(i);
  for (int64_t q = 60; q < n; q += 13) task.queries.push_back({q, {{{0, q - 50}, {}}}});
  return task;
}

void expect_what_retrieve_finds(const FloatMatrix& all, const Basis& basis,
                                const RetrieveOptions& options) {
  const RetrievalTask task = past_of(all.n);
  RetrieveOptions with_similarity = options;
  with_similarity.similarity = basis.similarity;
  const std::vector<Match> expected = retrieve(all, task, with_similarity);
  PlaceIndex index(basis);
  for (int64_t i = 0; i < all.n; ++i) index.add(all.row(i));
  for (size_t q = 0; q < expected.size(); ++q) {
    const TaskQuery& query = task.queries[q];
    const Match found =
        index.best(all.row(query.scan), std::span(query.candidates).first(1), options);
    EXPECT_EQ(found.ranks, expected[q].ranks) << query.scan;
    EXPECT_EQ(found.similarities, expected[q].similarities) << query.scan;
    EXPECT_EQ(found.score, expected[q].score) << query.scan;
  }
}

void expect_same(const Match& a, const Match& b) {
  EXPECT_EQ(a.ranks, b.ranks);
  EXPECT_EQ(a.similarities, b.similarities);
  EXPECT_EQ(a.score, b.score);
}

Basis rings_of(const RingLayout& layout, int64_t key_candidates) {
  Basis basis;
  basis.dim = layout.numbers();
  basis.similarity = ring_similarity(layout);
  basis.key_of = ring_key(layout);
  basis.key_candidates = key_candidates;
  return basis;
}

PlaceIndex index_of(const Basis& basis, const FloatMatrix& all) {
  PlaceIndex index(basis);
  for (int64_t i = 0; i < all.n; ++i) index.add(all.row(i));
  return index;
}

/// A source that looks at all keys, and remembers what it was asked.
struct AllKeys : CandidateSource {
  FloatMatrix keys;
  mutable int64_t asked = 0;
  int64_t size() const override { return keys.n; }
  void add(std::span<const float> key) override {
    keys.d = static_cast<int64_t>(key.size());
    keys.values.insert(keys.values.end(), key.begin(), key.end());
    ++keys.n;
  }
  void find(std::span<const float> key, int64_t count,
            std::vector<int64_t>& places) const override {
    asked = count;
    std::vector<float> products(static_cast<size_t>(keys.n));
    products_of_rows(key, keys, 0, products);
    places.clear();
    for (const size_t i : positions_of_largest(products, count))
      places.push_back(static_cast<int64_t>(i));
    std::ranges::reverse(places);
  }
};

std::unique_ptr<AllKeys> source_of(const PlaceIndex& index) {
  auto source = std::make_unique<AllKeys>();
  std::vector<float> key(static_cast<size_t>(index.key_numbers()));
  for (int64_t i = 0; i < index.size(); ++i) {
    index.make_key(index.descriptor(i), key);
    source->add(key);
  }
  return source;
}

TEST(PlaceIndex, FindsWhatRetrieveFindsByCosine) {
  Basis basis;
  basis.dim = 37;
  expect_what_retrieve_finds(random_descriptors(2500, 37), basis, {.k = 4});
  expect_what_retrieve_finds(random_descriptors(1024, 37), basis, {.k = 1, .score = Score::kBest});
}

TEST(PlaceIndex, FindsWhatRetrieveFindsByRings) {
  const RingLayout layout{{3, 2, 5, 1}};
  Basis basis;
  basis.dim = layout.numbers();
  basis.similarity = ring_similarity(layout);
  const FloatMatrix all = random_descriptors(1300, basis.dim);
  expect_what_retrieve_finds(all, basis, {.k = 4});
  // With keys, when the candidates are enough.
  basis.key_of = ring_key(layout);
  basis.key_candidates = 1300;
  expect_what_retrieve_finds(all, basis, {.k = 4});
  basis.key_candidates = 60;
  const RetrievalTask task = past_of(all.n);
  PlaceIndex index(basis);
  for (int64_t i = 0; i < all.n; ++i) index.add(all.row(i));
  RetrieveOptions by_keys;
  by_keys.similarity =
      similarity_by_keys(basis.similarity, basis.key_of, keys_of(all, basis.key_of), 60);
  const std::vector<Match> expected = retrieve(all, task, by_keys);
  for (size_t q = 0; q < expected.size(); ++q)
    EXPECT_EQ(
        index.best(all.row(task.queries[q].scan), std::span(task.queries[q].candidates).first(1))
            .ranks,
        expected[q].ranks);
}

TEST(PlaceIndex, RangesMayBeginAndEndAnywhere) {
  const FloatMatrix all = random_descriptors(4100, 19);
  Basis basis;
  basis.dim = 19;
  const PlaceIndex index = index_of(basis, all);
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
  const RingLayout layout{{3, 2, 5, 1}};
  Basis cosines;
  cosines.dim = layout.numbers();
  const FloatMatrix all = random_descriptors(5000, cosines.dim);
  FloatMatrix queries(130, all.d);
  std::copy_n(all.values.begin(), queries.values.size(), queries.values.begin());
  const std::vector<CandidateRange> candidates = {{0, 2500}, {2600, 4990}};
  for (const Basis& basis : {cosines, rings_of(layout, 0), rings_of(layout, 40)}) {
    const PlaceIndex index = index_of(basis, all);
    const std::vector<Match> many = index.best_of_many(queries, candidates, {.threads = 3});
    ASSERT_EQ(many.size(), 130);
    for (int64_t q = 0; q < queries.n; ++q) {
      const Match one = index.best(queries.row(q), candidates);
      expect_same(index.best(queries.row(q), candidates, {.threads = 4}), one);
      // The product of many rounds in another way, which chooses others among equal keys only.
      EXPECT_EQ(many[static_cast<size_t>(q)].similarities, one.similarities);
      if (!basis.similarity) expect_same(many[static_cast<size_t>(q)], one);
    }
  }
}

TEST(PlaceIndex, LosesNothingToTheSizeOfNumbers) {
  FloatMatrix all = random_descriptors(1500, 16);
  for (int64_t i = 0; i < all.n; ++i)
    for (float& v : all.row(i)) v *= i % 3 == 0 ? 1e-30F : i % 3 == 1 ? 1e30F : 1;
  std::ranges::fill(all.row(5), 0.0F);
  Basis basis;
  basis.dim = 16;
  expect_what_retrieve_finds(all, basis, {.k = 6});
}

TEST(PlaceIndex, ComparesWhatASourceProposes) {
  const RingLayout layout{{3, 2, 5, 1}};
  Basis cosines;
  cosines.dim = layout.numbers();
  const FloatMatrix all = random_descriptors(1500, cosines.dim);
  const std::vector<CandidateRange> candidates = {{0, 700}, {710, 1500}};
  for (const Basis& basis : {cosines, rings_of(layout, 60)}) {
    const PlaceIndex exact = index_of(basis, all);
    PlaceIndex index = index_of(basis, all);
    auto source = source_of(index);
    const AllKeys& asked = *source;
    index.choose_by(std::move(source), 60);
    for (int64_t q = 700; q < 800; ++q) {
      const Match found = index.best(all.row(q), candidates),
                  expected = exact.best(all.row(q), candidates);
      EXPECT_EQ(asked.asked, 70);  // and so many as may be left out
      if (!basis.similarity) expect_same(found, expected);
      // Where the keys choose 60, it compares these and up to ten more.
      for (size_t i = 0; i < expected.ranks.size(); ++i)
        EXPECT_GE(found.similarities[i], expected.similarities[i]);
    }
    index.add(all.row(0));
    EXPECT_EQ(asked.size(), 1501);
    EXPECT_EQ(index.best_of_many(all, candidates).size(), 1500);
  }
}

/// It never finds anything.
struct NoKeys : CandidateSource {
  int64_t size() const override { return 1500; }
  void add(std::span<const float>) override {}
  void find(std::span<const float>, int64_t, std::vector<int64_t>& places) const override {
    places.assign({3, 9999, -1});
  }
};

TEST(PlaceIndex, SearchesAllWhereASourceFindsTooFew) {
  const RingLayout layout{{3, 2, 5, 1}};
  Basis cosines;
  cosines.dim = layout.numbers();
  const FloatMatrix all = random_descriptors(1500, cosines.dim);
  const CandidateRange candidates{0, 1500}, third{3, 4};
  for (const Basis& basis : {cosines, rings_of(layout, 0), rings_of(layout, 60)}) {
    PlaceIndex index = index_of(basis, all);
    const Match expected = index.best(all.row(8), {&candidates, 1});
    index.choose_by(std::make_unique<NoKeys>(), 10);
    expect_same(index.best(all.row(8), {&candidates, 1}), expected);
    EXPECT_EQ(index.best(all.row(8), {&third, 1}).ranks, std::vector<int64_t>{3});
  }
}

TEST(PlaceIndex, RefusesASourceOfOtherPlaces) {
  Basis basis;
  basis.dim = 2;
  PlaceIndex index(basis);
  expect_error<UsageError>([&] { index.choose_by(std::make_unique<NoKeys>(), 5); },
                           {"source of 0 places", "1500"});
  expect_error<UsageError>([&] { index.choose_by(std::make_unique<AllKeys>(), 0); },
                           {"at least 1 candidate"});
  basis.similarity = ring_similarity({{1, 1}});
  PlaceIndex without_keys(basis);
  expect_error<UsageError>([&] { without_keys.choose_by(std::make_unique<AllKeys>(), 5); },
                           {"needs keys"});
}

TEST(PlaceIndex, RecallIsTheShareOfExactRanks) {
  const std::vector<Match> exact = {{.ranks = {1, 2, 3, 4}}, {.ranks = {5}}},
                           found = {{.ranks = {4, 9, 1, 8}}, {.ranks = {}}}, none(2);
  EXPECT_DOUBLE_EQ(recall_of(exact, found), 0.4);
  EXPECT_EQ(recall_of(none, found), 1);
  expect_error<UsageError>([&] { recall_of(exact, {}); }, {"2 queries", "found 0"});
}

TEST(PlaceIndex, OfNothingFindsNothing) {
  Basis basis;
  basis.dim = 2;
  PlaceIndex index(basis);
  const std::vector<float> x{1, 2};
  const CandidateRange all{0, 100}, none{5, 5};
  EXPECT_TRUE(index.best(x, {&all, 1}).ranks.empty());
  index.add(x);
  EXPECT_TRUE(index.best(x, {&none, 1}).ranks.empty());
  EXPECT_TRUE(index.best(x, {}).ranks.empty());
  EXPECT_EQ(index.best(x, {&all, 1}).ranks, std::vector<int64_t>{0});
  EXPECT_DOUBLE_EQ(index.best(x, {&all, 1}).similarities[0], 1);
}

TEST(PlaceIndex, RefusesWhatIsNoDescriptor) {
  Basis basis;
  basis.dim = 2;
  PlaceIndex index(basis);
  expect_error<UsageError>([&] { index.add(std::vector<float>{1, 2, 3}); }, {"2 numbers", "3"});
  expect_error<UsageError>(
      [&] {
        index.add(std::vector<float>{1, std::numeric_limits<float>::quiet_NaN()});
      },
      {"not finite"});
  EXPECT_EQ(index.size(), 0);
  const std::vector<float> x{1, 2, 3};
  const CandidateRange all{0, 1};
  expect_error<UsageError>([&] { index.best(x, {&all, 1}); }, {"query of 2 numbers", "3"});
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
  expect_error<UsageError>([&] { copy_points({packed, 2, 8}, cloud); }, {"stride", "12", "8"});
  expect_error<UsageError>([&] { copy_points({nullptr, 2}, cloud); }, {"2 points without data"});
  copy_points({}, cloud);
  EXPECT_TRUE(cloud.points.empty());
}

}  // namespace
}  // namespace revisit::pipeline
