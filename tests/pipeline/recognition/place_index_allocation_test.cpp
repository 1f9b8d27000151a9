#include "counting_new.h"
#include "revisit/recognition/place_index.h"
#include "revisit/recognition/ring/descriptor.h"
#include "testing.h"

namespace revisit {
namespace {

void expect_only_the_result(int64_t dim, const Comparison& comparison,
                            Score score = Score::kMargin) {
  PlaceIndex index(dim, comparison);
  std::mt19937 random(5);
  std::normal_distribution<float> gaussian;
  std::vector<float> x(static_cast<size_t>(dim));
  for (int64_t i = 0; i < 3000; ++i) {
    for (float& value : x) value = gaussian(random);
    index.add(x);
  }
  const std::vector<CandidateRange> candidates = {{0, 1500}, {1600, 2990}};
  const SearchOptions options{.score = score};
  for (int64_t q = 0; q < 20; ++q) index.best(index.descriptor(q), candidates, options);
  const std::vector<float> query = index.descriptor(9);
  const int64_t before = test::allocations;
  const Match match = index.best(query, candidates, options);
  EXPECT_LE(test::allocations - before, 2);  // its ranks and similarities
  EXPECT_EQ(match.ranks.size(), 4);
}

TEST(PlaceIndexMemory, AQueryAllocatesItsResultOnly) {
  expect_only_the_result(21, {});
  const RingLayout layout{3, 2, 5, 2};
  for (const int64_t candidates : {0, 100}) {
    Comparison rings = ring_comparison(layout, candidates);
    rings.relative_yaw = nullptr;
    expect_only_the_result(dim_of(layout), rings);
    rings.same_place = 1e9;  // their length is not 1; all are distinct
    expect_only_the_result(dim_of(layout), rings, Score::kDistinctMargin);
  }
}

}  // namespace
}  // namespace revisit
