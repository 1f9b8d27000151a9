#include "float_matrix.h"
#include "revisit/evaluation/descriptors.h"
#include "testing.h"

namespace revisit {
namespace {

Trajectory consecutive(int64_t n) {
  Trajectory trajectory;
  trajectory.frames.resize(n);
  std::iota(trajectory.frames.begin(), trajectory.frames.end(), 0);
  return trajectory;
}

/// Stored rows 0..s-1, queries the rest.
Task first_stored(int64_t n, int64_t s) {
  Task task;
  task.name = "test";
  for (int64_t i = 0; i < s; ++i) task.stored.push_back(i);
  for (int64_t i = s; i < n; ++i) task.queries.push_back({i, {CandidateRange{0, s}, {}}});
  return task;
}

/// Reference for retrieve(): all candidates sorted, in double.
Match slow_twin(const FloatMatrix& asked, const FloatMatrix& stored, const Task& task,
                const TaskQuery& query, int k) {
  std::vector<std::pair<double, int64_t>> all;
  for (const CandidateRange& range : query.candidates)
    for (int64_t c = range.begin; c < range.end; ++c) {
      double ab = 0, aa = 0, bb = 0;
      for (int64_t j = 0; j < stored.d; ++j) {
        const double a = asked.row(query.scan)[j], b = stored.row(task.stored[c])[j];
        ab += a * b;
        aa += a * a;
        bb += b * b;
      }
      all.emplace_back(aa > 0 && bb > 0 ? -ab / std::sqrt(aa * bb) : 0, task.stored[c]);
    }
  std::sort(all.begin(), all.end());
  Match match;
  for (size_t i = 0; i < std::min<size_t>(k, all.size()); ++i) {
    match.ranks.push_back(all[i].second);
    match.similarities.push_back(-all[i].first);
  }
  match.score = 2 * match.similarities.front() - match.similarities.back();
  return match;
}

TEST(Retrieve, ScoreByHand) {
  // Cosines of the query (1, 0) with rows 0..4: 1, 0.8, 0.6, 0, -1. Lengths do not matter.
  const FloatMatrix m = matrix({{2, 0}, {4, 3}, {-1, 0}, {3, 4}, {0, 5}, {7, 0}});
  const Match match = retrieve({m}, first_stored(6, 5)).at(0);
  EXPECT_EQ(match.query, 5);
  EXPECT_EQ(match.ranks, (std::vector<int64_t>{0, 1, 3, 4}));
  EXPECT_NEAR(match.score, 2 * 1 - 0, 1e-12);
  EXPECT_NEAR(retrieve({m}, first_stored(6, 5), {.k = 3}).at(0).score, 2 - 0.6, 1e-7);
  EXPECT_NEAR(retrieve({m}, first_stored(6, 5), {.score = Score::kSimilarity}).at(0).score, 1,
              1e-12);
  EXPECT_EQ(match.which_case, 1);
}

TEST(Retrieve, FewerStoredThanK) {
  const FloatMatrix m = matrix({{3, 4}, {0, 1}, {1, 0}});
  const Match two = retrieve({m}, first_stored(3, 2), {.k = 4}).at(0);
  EXPECT_EQ(two.ranks.size(), 2u);
  EXPECT_NEAR(two.score, 2 * 0.6 - 0, 1e-7);
  Task one = first_stored(3, 1);
  EXPECT_NEAR(retrieve({m}, one, {.k = 4}).at(1).score, 0.6, 1e-7);  // 2 c1 - c1
}

TEST(Retrieve, AgreesWithTheSlowTwin) {
  const FloatMatrix m = random_matrix(1300, 37, 1);
  for (const char* protocol : {"online", "leave-one-out", "paper-easy"}) {
    SCOPED_TRACE(protocol);
    const Task task =
        make_tasks(protocol, "", consecutive(m.n), parse_exclusion("frames=50")).at(0);
    const std::vector<Match> matches = retrieve({m}, task, {.k = 4});
    ASSERT_EQ(matches.size(), task.queries.size());
    for (size_t q = 0; q < matches.size(); q += 7) {
      const Match slow = slow_twin(m, m, task, task.queries[q], 4);
      EXPECT_EQ(matches[q].ranks, slow.ranks) << q;
      EXPECT_NEAR(matches[q].score, slow.score, 1e-12) << q;
    }
  }
}

TEST(Retrieve, EqualScansAreOrderedByIndex) {
  // Copies of five scans, spread over several blocks of the product.
  const FloatMatrix five = random_matrix(5, 100, 3);
  FloatMatrix m(1200, 100);
  for (int64_t i = 0; i < m.n; ++i) std::copy_n(five.row(i % 5).begin(), 100, m.row(i).begin());
  for (const Match& match : retrieve({m}, first_stored(m.n, 1100), {.k = 6})) {
    const int64_t kind = match.query % 5;
    for (int64_t r = 0; r < 6; ++r) EXPECT_EQ(match.ranks[r], kind + 5 * r);
    EXPECT_EQ(match.similarities.front(), match.similarities.back());
  }
}

TEST(Retrieve, ZeroDescriptorsAreLikeNothing) {
  const FloatMatrix m = matrix({{0, 0}, {-1, 0}, {0, 0}, {1, 0}});
  const Match match = retrieve({m}, first_stored(4, 3)).at(0);
  EXPECT_EQ(match.ranks, (std::vector<int64_t>{0, 2, 1}));
  EXPECT_EQ(match.similarities, (std::vector<double>{0, 0, -1}));
  const FloatMatrix all_zero(3000, 2);
  EXPECT_EQ(retrieve({all_zero}, first_stored(3000, 2999)).at(0).ranks,
            (std::vector<int64_t>{0, 1, 2, 3}));
}

TEST(Retrieve, HugeAndTinyDescriptors) {
  FloatMatrix m = matrix({{1e30F, 0}, {1e-30F, 1e-30F}, {0, 1}, {1e-38F, 0}});
  const Match match = retrieve({m}, first_stored(4, 3)).at(0);
  EXPECT_EQ(match.ranks, (std::vector<int64_t>{0, 1, 2}));
  EXPECT_NEAR(match.similarities[1], std::sqrt(0.5), 1e-6);
}

TEST(Retrieve, HigherScoreOfTheTwoCasesWins) {
  const FloatMatrix m = random_matrix(400, 16, 5), turned = random_matrix(400, 16, 6);
  const Task task = first_stored(400, 300);
  const std::vector<Match> matches = retrieve({m, turned}, task, {}, QueryCase::kBoth);
  int second = 0;
  for (size_t q = 0; q < matches.size(); ++q) {
    const Match one = slow_twin(m, m, task, task.queries[q], 4),
                two = slow_twin(turned, m, task, task.queries[q], 4);
    const Match& better = two.score > one.score ? two : one;
    EXPECT_EQ(matches[q].which_case, two.score > one.score ? 2 : 1);
    EXPECT_EQ(matches[q].ranks, better.ranks);
    EXPECT_NEAR(matches[q].score, better.score, 1e-12);
    second += matches[q].which_case == 2;
  }
  EXPECT_GT(second, 0);
  EXPECT_LT(second, 100);
  for (const Match& match : retrieve({m, m}, task, {}, QueryCase::kBoth))
    EXPECT_EQ(match.which_case, 1);  // a tie
}

/// Minus the distance on a line: descriptors of one number.
Comparison nearness() {
  return {.similarity = [](std::span<const float> query,
                           std::span<const std::span<const float>> places,
                           std::span<double> similarities) {
    for (size_t i = 0; i < places.size(); ++i)
      similarities[i] = -std::abs(double{query[0]} - places[i][0]);
  }};
}

TEST(Retrieve, BySimilarityOfItsOwn) {
  // Distances from 5: row 0: 4, row 1: 1, row 2: 2, row 3: 1, row 4: 4. Ties are ordered by row.
  const FloatMatrix m = matrix({{1}, {4}, {7}, {6}, {9}, {5}});
  Descriptors descriptors{m, {}, nearness()};
  const Match match = retrieve(descriptors, first_stored(6, 5)).at(0);
  EXPECT_EQ(match.ranks, (std::vector<int64_t>{1, 3, 2, 0}));
  EXPECT_EQ(match.similarities, (std::vector<double>{-1, -1, -2, -4}));
  EXPECT_EQ(match.score, 2 * -1 - -4);
  EXPECT_EQ(retrieve(descriptors, first_stored(6, 5), {.score = Score::kSimilarity}).at(0).score,
            -1);
  // Case 2 queries with another descriptor, 9; the stored ones are unchanged.
  descriptors.case2 = matrix({{0}, {0}, {0}, {0}, {0}, {9}});
  for (const QueryCase asked : {QueryCase::kBoth, QueryCase::kTwo}) {
    const Match second =
        retrieve(descriptors, first_stored(6, 5), {.score = Score::kSimilarity}, asked).at(0);
    EXPECT_EQ(second.which_case, 2);
    EXPECT_EQ(second.ranks[0], 4);
  }
}

TEST(Retrieve, BySimilarityOnlyCandidatesAreCompared) {
  const FloatMatrix m = random_matrix(300, 1, 4);
  const Task task =
      make_tasks("leave-one-out", "", consecutive(m.n), parse_exclusion("frames=40")).at(0);
  const std::vector<Match> one = retrieve({m, {}, nearness()}, task);
  const std::vector<Match> three = retrieve({m, {}, nearness()}, task, {.threads = 3});
  ASSERT_EQ(one.size(), task.queries.size());
  for (size_t q = 0; q < one.size(); ++q) {
    int64_t nearest = -1;
    const int64_t asked = task.queries[q].scan;
    const auto distance = [&](int64_t s) { return std::abs(m.row(asked)[0] - m.row(s)[0]); };
    for (int64_t s = 0; s < m.n; ++s)
      if (std::abs(s - asked) > 40 && (nearest < 0 || distance(s) < distance(nearest))) nearest = s;
    EXPECT_EQ(one[q].ranks[0], nearest);
    EXPECT_EQ(one[q].ranks, three[q].ranks);
    EXPECT_EQ(one[q].similarities, three[q].similarities);
  }
}

TEST(Retrieve, EntriesWithoutACandidatesCodeHaveTheLowestSimilarity) {
  struct Two : CandidateSource {
    int64_t places = 0;
    int64_t size() const override { return places; }
    void add(std::span<const float>) override { ++places; }
    void find(std::span<const float>, std::span<const CandidateRange>, int64_t count, int,
              std::vector<int64_t>& found) const override {
      EXPECT_EQ(count, 2);
      found.assign({4, 2});
    }
  };
  Comparison by_codes = nearness();
  by_codes.make_codes = [] { return std::make_unique<Two>(); };
  by_codes.candidates = 2;
  const FloatMatrix m = matrix({{0.125F}, {0.5F}, {0.75F}, {0.625F}, {1}, {0.5F}});
  const Match match = retrieve({m, {}, by_codes}, first_stored(6, 5)).at(0);
  EXPECT_EQ(match.ranks, (std::vector<int64_t>{2, 4, 0, 1}));
  EXPECT_EQ(match.similarities, (std::vector<double>{-0.25, -0.5, -1, -1}));
  EXPECT_EQ(match.score, 2 * -0.25 - -1);
}

TEST(Retrieve, RefusesASimilarityThatIsNone) {
  Descriptors descriptors{random_matrix(4, 2, 1)};
  descriptors.comparison.similarity = [](auto, auto, std::span<double> similarities) {
    similarities.back() = std::nan("");
  };
  expect_error<Error>([&] { retrieve(descriptors, first_stored(4, 3)); },
                      {"query 0 to entry 2 is not finite"});
  descriptors.comparison = nearness();
  EXPECT_THROW(retrieve(descriptors, first_stored(4, 3), {.threads = 0}), UsageError);
}

TEST(Retrieve, RefusesNonsense) {
  FloatMatrix m = matrix({{1, 0}, {0, 1}, {1, 1}});
  EXPECT_THROW(retrieve({m}, first_stored(3, 2), {.k = 0}), UsageError);
  EXPECT_THROW(retrieve({m}, first_stored(4, 2)), Error);  // a scan without a descriptor
  EXPECT_THROW(retrieve({m}, first_stored(3, 0)), Error);  // no candidates
  const FloatMatrix other(3, 5);
  EXPECT_THROW(retrieve({m, other}, first_stored(3, 2), {}, QueryCase::kBoth), Error);
  EXPECT_THROW(retrieve({m}, first_stored(3, 2), {}, QueryCase::kTwo), Error);
  m.row(1)[0] = std::nanf("");
  expect_error<Error>([&] { retrieve({m}, first_stored(3, 2)); }, {"scan 1", "case 1"});
  EXPECT_THROW(parse_score("best"), UsageError);
}

TEST(Retrieve, StopsWhenAsked) {
  const FloatMatrix m = random_matrix(20, 3, 1);
  EXPECT_THROW(retrieve({m}, first_stored(20, 10), {.stop = [] { return true; }}), Interrupted);
  int64_t last = 0, total = 0;
  retrieve({m}, first_stored(20, 10),
           {.progress = [&](int64_t done, int64_t all) { last = done, total = all; }});
  EXPECT_EQ(last, 10);
  EXPECT_EQ(total, 10);
  retrieve({m, m}, first_stored(20, 10),
           {.progress = [&](int64_t done, int64_t all) { last = done, total = all; }},
           QueryCase::kBoth);
  EXPECT_EQ(last, 20);
  EXPECT_EQ(total, 20);
}

}  // namespace
}  // namespace revisit
