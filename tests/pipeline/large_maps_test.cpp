#include "revisit/maps/large_maps.h"

#include <gtest/gtest.h>

#include <random>

#include "expect_error.h"
#include "revisit/recognition/cosine.h"
#include "revisit/recognition/ring/match.h"

namespace revisit::pipeline {
namespace {

using test::expect_error;

#ifdef REVISIT_HAVE_FAISS

/// Of length 1; numbers vary the less the later they are.
FloatMatrix descriptors(int64_t n, int64_t d) {
  FloatMatrix all(n, d);
  std::mt19937 random(8);
  std::normal_distribution<float> gaussian;
  for (int64_t i = 0; i < n; ++i) {
    const std::span<float> x = all.row(i);
    for (size_t j = 0; j < x.size(); ++j)
      x[j] = gaussian(random) / std::sqrt(static_cast<float>(j + 1));
    const auto length = static_cast<float>(length_of(x));
    for (float& value : x) value /= length;
  }
  return all;
}

PlaceIndex index_of(const Basis& basis, const FloatMatrix& all, int64_t n) {
  PlaceIndex index(basis);
  for (int64_t i = 0; i < n; ++i) index.add(all.row(i));
  return index;
}

/// Nearly all is found, what is found is scored exactly, and places may be added.
template <class Make>
void expect_found(const Basis& basis, const Make& make, double least_recall) {
  constexpr int64_t kBuilt = 2000, kAll = 2300;
  const FloatMatrix all = descriptors(kAll, basis.dim);
  const PlaceIndex exact = index_of(basis, all, kAll);
  PlaceIndex index = index_of(basis, all, kBuilt);
  index.choose_by(make(index), 100);
  for (int64_t i = kBuilt; i < kAll; ++i) index.add(all.row(i));
  const std::vector<CandidateRange> candidates = {{0, 1000}, {1003, kAll}};
  std::vector<Match> expected, found;
  for (int64_t q = 0; q < kAll; q += 23) {
    expected.push_back(exact.best(all.row(q), candidates));
    found.push_back(index.best(all.row(q), candidates));
    if (found.back().ranks == expected.back().ranks) {
      EXPECT_EQ(found.back().similarities, expected.back().similarities);
      EXPECT_EQ(found.back().score, expected.back().score);
    }
    for (const int64_t place : found.back().ranks) EXPECT_TRUE(place < 1000 || place >= 1003);
  }
  EXPECT_GE(recall_of(expected, found), least_recall);
}

Basis rings() {
  const RingLayout layout{{9, 8, 8, 4}};
  Basis basis;
  basis.dim = layout.numbers();
  basis.similarity = ring_similarity(layout);
  basis.key_of = ring_key(layout);
  basis.key_candidates = 100;
  return basis;
}

TEST(LargeMaps, GraphsFindNearlyAll) {
  Basis cosines;
  cosines.dim = 43;
  for (const Basis& basis : {cosines, rings()})
    expect_found(
        basis, [](const PlaceIndex& index) { return graph_of_keys(index); }, 0.95);
}

TEST(LargeMaps, ListsFindNearlyAll) {
  Basis cosines;
  cosines.dim = 43;  // which no whole number of bytes codes
  for (const Basis& basis : {cosines, rings()})
    expect_found(
        basis,
        [](const PlaceIndex& index) {
          return lists_of_keys(index, {.lists = 20, .probes = 20, .numbers_per_byte = 2});
        },
        0.9);
}

TEST(LargeMaps, RefuseWhatCannotBeBuilt) {
  Basis basis;
  basis.dim = 4;
  const FloatMatrix all = descriptors(300, 4);
  const PlaceIndex empty(basis), some = index_of(basis, all, 300);
  expect_error<UsageError>([&] { graph_of_keys(empty); }, {"at least 1 places", "found 0"});
  expect_error<UsageError>([&] { lists_of_keys(empty); }, {"at least 256 places", "found 0"});
  expect_error<UsageError>([&] { graph_of_keys(some, {.links = 1}); }, {"links", "found 1"});
  expect_error<UsageError>([&] { lists_of_keys(some, {.lists = 301}); }, {"lists", "found 301"});
  expect_error<UsageError>([&] { lists_of_keys(some, {.probes = 0}); }, {"probes", "found 0"});
  basis.similarity = ring_similarity({{2, 1}});
  expect_error<UsageError>([&] { graph_of_keys(PlaceIndex(basis)); }, {"no keys"});
}

#else

TEST(LargeMaps, AreSaidToBeMissing) {
  Basis basis;
  basis.dim = 4;
  expect_error<UsageError>([&] { graph_of_keys(PlaceIndex(basis)); }, {"libfaiss-dev"});
  expect_error<UsageError>([&] { lists_of_keys(PlaceIndex(basis)); }, {"libfaiss-dev"});
}

#endif

}  // namespace
}  // namespace revisit::pipeline
