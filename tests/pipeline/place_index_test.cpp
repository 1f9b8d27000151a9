#include "revisit/recognition/place_index.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <limits>
#include <random>

#include "expect_error.h"
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
