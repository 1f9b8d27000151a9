#include "recall.h"
#include "revisit/maps/map.h"
#include "revisit/recognition/matrix.h"
#include "revisit/recognition/ring/descriptor.h"
#include "testing.h"

namespace revisit {
namespace {

#ifdef REVISIT_HAVE_FAISS

/// Unit vectors; later components have smaller variance.
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

TEST(LargeMaps, HnswFindsNearlyAll) {
  constexpr int64_t kBuilt = 2000, kAll = 2300;
  const FloatMatrix all = descriptors(kAll, 43);
  PlaceIndex exact(all.d), index(all.d);
  for (int64_t i = 0; i < kAll; ++i) {
    exact.add(all.row(i));
    index.add(all.row(i));
    if (i + 1 == kBuilt) index.set_candidate_source(make_hnsw_source(index), 100);
  }
  const std::vector<CandidateRange> candidates = {{0, 1000}, {1003, kAll}};
  std::vector<Match> expected, found;
  for (int64_t q = 0; q < kAll; q += 23) {
    expected.push_back(exact.best(all.row(q), candidates));
    found.push_back(index.best(all.row(q), candidates));
    if (found.back().ranks == expected.back().ranks) {
      EXPECT_EQ(found.back().similarities, expected.back().similarities);
      EXPECT_EQ(found.back().score, expected.back().score);
    }
    for (const int64_t entry : found.back().ranks) EXPECT_TRUE(entry < 1000 || entry >= 1003);
  }
  EXPECT_GE(recall_of(expected, found), 0.95);
}

TEST(LargeMaps, RejectsInvalidIndexes) {
  const PlaceIndex empty(4);
  expect_error<UsageError>([&] { make_hnsw_source(empty); }, {"it has no entries"});
  expect_error<UsageError>(
      [&] {
        make_hnsw_source(PlaceIndex(4, ring_comparison({2, 1})));
      },
      {"not compared by cosine"});
}

#else

TEST(LargeMaps, ReportsAMissingLibrary) {
  expect_error<UsageError>([&] { make_hnsw_source(PlaceIndex(4)); }, {"libfaiss-dev"});
}

#endif

}  // namespace
}  // namespace revisit
